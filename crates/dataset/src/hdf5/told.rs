//! What is said of a file that cannot be read.

use hdf5_reader::error::Error;

use super::filters;

/// The error itself, without the names of what it lies in.
pub(super) fn root_cause(error: &Error) -> &Error {
    match error {
        Error::Context { source, .. } => root_cause(source),
        error => error,
    }
}

/// What is wrong, and where there is one the remedy.
pub(super) fn told(error: &Error) -> String {
    match root_cause(error) {
        Error::UnsupportedFilter(filter) => filters::unsupported(filter),
        Error::UnsupportedEncoding(reason) => reason.clone(),
        // The layout of HDF5's virtual data sets.
        Error::UnsupportedLayoutClass(3) => {
            "is a virtual data set, whose values lie in other files, and is not read; write them \
             into one file with h5py, as in new['key'] = old['key'][()]"
                .to_owned()
        }
        Error::UnsupportedLayoutVersion(_)
        | Error::UnsupportedLayoutClass(_)
        | Error::UnsupportedChunkIndexType(_) => format!(
            "is stored in a newer form than is read ({}); `h5repack OLD NEW` writes one that is",
            root_cause(error)
        ),
        error => error.to_string(),
    }
}
