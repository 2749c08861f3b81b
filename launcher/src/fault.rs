//! Errors as the user sees them: whether the cause is in what they gave, and the message.

use agents::{BuildError, StageError};
use dataset::{DatasetError, LoadError, MappedError};
use nets::file::FileError;

/// A fault in what the user gave, as a sentence.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Input(pub(crate) String);

/// An error and its causes, each once: with some libraries the text of an error includes its cause.
pub(crate) fn sentence(error: &anyhow::Error) -> String {
    let mut sentence = String::new();
    for cause in error.chain() {
        let cause = cause.to_string();
        if sentence.is_empty() {
            sentence = cause;
        } else if !sentence.contains(&cause) {
            sentence = format!("{sentence}: {cause}");
        }
    }
    sentence
}

/// Whether the cause of an error is in what the user gave.
pub(crate) fn is_input(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.is::<Input>()
            || cause.is::<config::Faults>()
            || matches!(
                cause.downcast_ref::<DatasetError>(),
                Some(error) if !matches!(error, DatasetError::Io { .. })
            )
            || matches!(
                cause.downcast_ref::<FileError>(),
                Some(error) if !matches!(error, FileError::Io { .. })
            )
            || matches!(
                cause.downcast_ref::<LoadError>(),
                Some(error) if !matches!(error, LoadError::Dataset(DatasetError::Io { .. }))
            )
            || matches!(
                cause.downcast_ref::<MappedError>(),
                Some(MappedError::Read { .. } | MappedError::Damaged { .. })
            )
            || matches!(
                cause.downcast_ref::<BuildError>(),
                Some(BuildError::Unusable(_) | BuildError::Cluster { .. })
            )
            || matches!(
                cause.downcast_ref::<StageError>(),
                Some(StageError::TooShort { .. } | StageError::TooSmall(_))
            )
            || matches!(
                cause.downcast_ref::<StageError>(),
                Some(StageError::Checkpoint { reason, .. })
                    if !matches!(reason, FileError::Io { .. })
            )
            || cause.is::<learner::Diverged>()
    })
}

#[cfg(test)]
mod tests {
    use anyhow::Context;

    use super::*;

    #[test]
    fn faults_of_the_input_are_found_in_any_context() {
        let input: Result<(), _> = Err(Input("mend it".to_owned()));
        assert!(is_input(&input.context("reading it").unwrap_err()));
        let path = std::path::PathBuf::from("a.hdf5");
        let reason = "cut off".to_owned();
        let format = DatasetError::Format {
            path: path.clone(),
            reason,
        };
        assert!(is_input(&format.into()));
        let source = std::io::Error::from_raw_os_error(5);
        assert!(!is_input(&DatasetError::Io { path, source }.into()));
        assert!(!is_input(&anyhow::anyhow!("something else")));
    }

    #[test]
    fn each_cause_is_named_once() {
        let path = std::path::PathBuf::from("a.hdf5");
        let source = std::io::Error::from_raw_os_error(2);
        let error = anyhow::Error::from(DatasetError::Io { path, source });
        let message = sentence(&error.context("reading the data"));
        let expected = "reading the data: a.hdf5: No such file or directory (os error 2)";
        assert_eq!(message, expected);
    }
}
