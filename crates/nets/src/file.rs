//! Parameter files: safetensors, written whole or not at all, with a checksum of their own in the
//! metadata (`crc32`), which the format lacks.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

/// A named tensor: name, shape, row-major values.
pub type Tensor<'a> = (String, Vec<usize>, &'a [f32]);

/// Why a parameter file could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The system refused.
    #[error("{path}: {source}", path = .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not a safetensors file, or a damaged one.
    #[error("not a whole safetensors file: {0}")]
    Damaged(String),
    /// A tensor that should be there is not.
    #[error("tensor '{0}' is missing")]
    Missing(String),
    /// A tensor of another shape or type.
    #[error("tensor '{name}' has shape {got:?}, expected {expected:?} of f32")]
    Shape {
        /// Its name.
        name: String,
        /// Shape wanted.
        expected: Vec<usize>,
        /// Shape found.
        got: Vec<usize>,
    },
    /// A value that is NaN or infinite.
    #[error("tensor '{name}' holds a value that is not finite at index {index}")]
    NotFinite {
        /// Its name.
        name: String,
        /// Index of the first such value.
        index: usize,
    },
}

/// Writes tensors and metadata beside `path`, syncs and renames.
///
/// # Errors
/// What the system or the format refuses.
pub fn save(
    path: &Path,
    tensors: &[Tensor<'_>],
    metadata: &BTreeMap<String, String>,
) -> Result<(), FileError> {
    let io = |source| FileError::Io {
        path: path.to_path_buf(),
        source,
    };
    let bytes: Vec<Vec<u8>> = tensors
        .iter()
        .map(|(_, _, values)| values.iter().flat_map(|v| v.to_le_bytes()).collect())
        .collect();
    let mut views = vec![];
    for ((name, shape, _), bytes) in tensors.iter().zip(&bytes) {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytes)
            .map_err(|error| FileError::Damaged(error.to_string()))?;
        views.push((name.clone(), view));
    }
    let mut metadata: HashMap<String, String> = metadata
        .iter()
        .map(|(k, v)| (k.clone(), v.clone()))
        .collect();
    let views_of = tensors
        .iter()
        .map(|(name, shape, values)| (name.as_str(), shape.as_slice(), *values));
    metadata.insert(CHECKSUM.to_owned(), checksum(views_of, &metadata));
    let mut whole = safetensors::serialize(views, Some(metadata))
        .map_err(|error| FileError::Damaged(error.to_string()))?;
    sort_header(&mut whole);
    durable::write(path, &whole).map_err(io)
}

/// Key of the checksum in the metadata.
const CHECKSUM: &str = "crc32";

/// CRC-32 of names, shapes, values and metadata, in an order of its own.
fn checksum<'a>(
    tensors: impl Iterator<Item = (&'a str, &'a [usize], &'a [f32])>,
    metadata: &HashMap<String, String>,
) -> String {
    let mut tensors: Vec<_> = tensors.collect();
    tensors.sort_unstable_by_key(|(name, ..)| *name);
    let mut hasher = crc32fast::Hasher::new();
    let mut text = |text: &str| {
        hasher.update(&(text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    };
    let mut keys: Vec<&String> = metadata.keys().filter(|key| *key != CHECKSUM).collect();
    keys.sort_unstable();
    for key in keys {
        text(key);
        text(&metadata[key]);
    }
    for (name, shape, values) in tensors {
        hasher.update(name.as_bytes());
        for width in shape {
            hasher.update(&(*width as u64).to_le_bytes());
        }
        for value in values {
            hasher.update(&value.to_le_bytes());
        }
    }
    format!("{:08x}", hasher.finalize())
}

/// Puts the header's keys in order, which safetensors leaves to chance: equal weights are equal
/// files. The header is a length (8 bytes), that much JSON and blanks.
fn sort_header(whole: &mut [u8]) {
    let Some((length, rest)) = whole.split_first_chunk_mut::<8>() else {
        return;
    };
    let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
    let Some(header) = rest.get_mut(..length) else {
        return;
    };
    let sorted = serde_json::from_slice::<serde_json::Value>(header)
        .and_then(|header| serde_json::to_vec(&header));
    if let Ok(sorted) = sorted
        && sorted.len() <= header.len()
    {
        let (text, blanks) = header.split_at_mut(sorted.len());
        text.copy_from_slice(&sorted);
        blanks.fill(b' ');
    }
}

/// A parameter file in memory.
pub struct ParameterFile {
    tensors: BTreeMap<String, (Vec<usize>, Vec<f32>)>,
    metadata: BTreeMap<String, String>,
}

impl ParameterFile {
    /// Reads a file.
    ///
    /// # Errors
    /// What the system refuses, or damage.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let bytes = std::fs::read(path).map_err(|source| FileError::Io {
            path: path.to_path_buf(),
            source,
        })?;
        Self::from_bytes(&bytes)
    }

    /// Reads a file's bytes.
    ///
    /// # Errors
    /// Damage.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, FileError> {
        let damaged = |error: safetensors::SafeTensorError| FileError::Damaged(error.to_string());
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
        let metadata = header.metadata().iter().flatten();
        let metadata = metadata.map(|(k, v)| (k.clone(), v.clone())).collect();
        let file = SafeTensors::deserialize(bytes).map_err(damaged)?;
        let mut tensors: BTreeMap<String, (Vec<usize>, Vec<f32>)> = BTreeMap::new();
        for (name, view) in file.tensors() {
            if view.dtype() == Dtype::F32 {
                let (values, _) = view.data().as_chunks::<4>();
                let values = values
                    .iter()
                    .map(|bytes| f32::from_le_bytes(*bytes))
                    .collect();
                tensors.insert(name, (view.shape().to_vec(), values));
            }
        }
        // Files of other programs have none.
        let metadata: HashMap<String, String> = metadata;
        if let Some(told) = metadata.get(CHECKSUM) {
            let views = tensors.iter().map(|(name, (shape, values))| {
                (name.as_str(), shape.as_slice(), values.as_slice())
            });
            if *told != checksum(views, &metadata) {
                return Err(FileError::Damaged("its checksum does not hold".to_owned()));
            }
        }
        let metadata = metadata.into_iter().filter(|(key, _)| key != CHECKSUM);
        Ok(Self {
            tensors,
            metadata: metadata.collect(),
        })
    }

    /// A tensor of a known shape.
    ///
    /// # Errors
    /// When it is missing, has another shape, or holds a value that is not finite.
    pub fn tensor(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, FileError> {
        let (got, values) = self
            .tensors
            .get(name)
            .ok_or_else(|| FileError::Missing(name.to_owned()))?;
        if got != shape {
            return Err(FileError::Shape {
                name: name.to_owned(),
                expected: shape.to_vec(),
                got: got.clone(),
            });
        }
        match values.iter().position(|value| !value.is_finite()) {
            Some(index) => Err(FileError::NotFinite {
                name: name.to_owned(),
                index,
            }),
            None => Ok(values.clone()),
        }
    }

    /// The metadata.
    #[must_use]
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("w.safetensors");
        let values: Vec<f32> = (0..12).map(|i| i as f32).collect();
        let metadata = BTreeMap::from([("hidden".to_owned(), "3,4".to_owned())]);
        save(&path, &[("a".to_owned(), vec![3, 4], &values)], &metadata).unwrap();
        (folder, path)
    }

    #[test]
    fn what_is_saved_is_loaded() {
        let (_folder, path) = written();
        let file = ParameterFile::load(&path).unwrap();
        assert_eq!(file.tensor("a", &[3, 4]).unwrap()[11], 11.0);
        assert_eq!(file.metadata()["hidden"], "3,4");
        assert!(matches!(file.tensor("b", &[1]), Err(FileError::Missing(_))));
        assert!(matches!(
            file.tensor("a", &[12]),
            Err(FileError::Shape { .. })
        ));
        assert!(!path.with_extension("part").exists());
    }

    #[test]
    fn equal_weights_are_equal_files() {
        let folder = tempfile::tempdir().unwrap();
        let keys = ["kind", "version", "config", "hidden", "seed", "maze"];
        let metadata: BTreeMap<String, String> =
            keys.map(|key| (key.to_owned(), key.to_uppercase())).into();
        let bytes = |name: &str| {
            let path = folder.path().join(name);
            let tensors = [
                ("b".to_owned(), vec![2], [1.0, 2.0].as_slice()),
                ("a".to_owned(), vec![1], [3.0].as_slice()),
            ];
            save(&path, &tensors, &metadata).unwrap();
            let file = ParameterFile::load(&path).unwrap();
            assert_eq!(file.metadata(), &metadata);
            assert_eq!(file.tensor("a", &[1]).unwrap(), [3.0]);
            std::fs::read(path).unwrap()
        };
        let first = bytes("0");
        (1..20).for_each(|i| assert_eq!(bytes(&i.to_string()), first));
    }

    #[test]
    fn damage_is_an_error_or_a_refused_value_never_a_panic() {
        let (_folder, path) = written();
        let bytes = std::fs::read(&path).unwrap();
        for length in 0..bytes.len() {
            assert!(
                ParameterFile::from_bytes(&bytes[..length]).is_err(),
                "cut at {length}"
            );
        }
        for at in 0..bytes.len() {
            let mut flipped = bytes.clone();
            flipped[at] ^= 0xff;
            // A flip that changes nothing (a blank of the header) or cannot be told from a file
            // without a checksum leaves the values as they were.
            if let Ok(file) = ParameterFile::from_bytes(&flipped) {
                let values = file.tensor("a", &[3, 4]).unwrap();
                assert!((0..12).all(|i| values[i] == i as f32), "byte {at}");
            }
        }
    }
}
