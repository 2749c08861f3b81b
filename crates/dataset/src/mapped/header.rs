//! Header of a mapped file: names and positions of its arrays.

use std::fs::File;
use std::io::{self, Read};
use std::ops::Range;

use serde::{Deserialize, Serialize};

const MAGIC: &[u8; 8] = b"FORMICAM";
const FORMAT: u32 = 1;
/// Offset of the description, and of the first byte that the checksum covers.
pub(super) const START: usize = 24;
const CHECKED: usize = 16;
/// Alignment of arrays: a cache line, and a multiple of every element's alignment.
const ALIGNMENT: u64 = 64;
/// Limit on the length of a description.
const LONGEST: u64 = 1 << 24;

/// Contents of a file.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Description {
    pub(super) kind: String,
    /// Encoded metadata of the writer.
    pub(super) about: Vec<u8>,
    pub(super) sections: Vec<Section>,
    /// Length of the whole file in bytes.
    pub(super) length: u64,
}

/// Position of an array.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Section {
    pub(super) name: String,
    /// Bytes of an element.
    pub(super) size: u64,
    /// Offset in the file.
    pub(super) start: u64,
    /// Length in bytes.
    pub(super) bytes: u64,
}

impl Section {
    /// Its byte range in the file.
    pub(super) fn bytes(&self) -> Option<Range<usize>> {
        let end = self.start.checked_add(self.bytes)?;
        Some(usize::try_from(self.start).ok()?..usize::try_from(end).ok()?)
    }
}

/// Lays out a file and encodes its header. `arrays` yields names, element sizes and lengths in bytes.
/// An error comes with the file's length.
pub(super) fn encode<'a>(
    kind: &str,
    about: &impl Serialize,
    arrays: impl Iterator<Item = (&'a str, usize, usize)>,
) -> Result<(Vec<u8>, Description), (u64, io::Error)> {
    let failed = |error: postcard::Error| (0, io::Error::other(error.to_string()));
    let mut description = Description {
        kind: kind.to_owned(),
        about: postcard::to_stdvec(about).map_err(failed)?,
        sections: vec![],
        length: 0,
    };
    for (name, size, bytes) in arrays {
        description.sections.push(Section {
            name: name.to_owned(),
            size: size as u64,
            start: 0,
            bytes: bytes as u64,
        });
    }
    // Offsets are not known yet and are encoded as varints: reserve room for the longest ones.
    let most = postcard::to_stdvec(&description).map_err(failed)?.len()
        + 10 * (description.sections.len() + 1);
    let mut end = (START + most) as u64;
    for section in &mut description.sections {
        section.start = end.next_multiple_of(ALIGNMENT);
        end = section.start + section.bytes;
    }
    description.length = end;
    let head = headed(&description).map_err(failed)?;
    Ok((head, description))
}

/// Encodes the header of a description.
pub(super) fn headed(description: &Description) -> Result<Vec<u8>, postcard::Error> {
    let text = postcard::to_stdvec(description)?;
    let mut head = Vec::with_capacity(START + text.len());
    head.extend(MAGIC);
    head.extend(FORMAT.to_le_bytes());
    head.extend([0; 4]);
    head.extend((text.len() as u64).to_le_bytes());
    head.extend(text);
    let checksum = crc32fast::hash(&head[CHECKED..]);
    head[CHECKED - 4..CHECKED].copy_from_slice(&checksum.to_le_bytes());
    Ok(head)
}

/// Reads and checks the header of a file of the given length. The inner error says what is wrong.
pub(super) fn read(file: &mut File, length: u64) -> io::Result<Result<Description, String>> {
    let mut head = vec![];
    Read::by_ref(file)
        .take(START as u64)
        .read_to_end(&mut head)?;
    let Some((fixed, [])) = head.split_first_chunk::<START>() else {
        return Ok(Err("it is truncated".to_owned()));
    };
    let [
        m0,
        m1,
        m2,
        m3,
        m4,
        m5,
        m6,
        m7,
        f0,
        f1,
        f2,
        f3,
        c0,
        c1,
        c2,
        c3,
        size @ ..,
    ] = *fixed;
    let format = u32::from_le_bytes([f0, f1, f2, f3]);
    if [m0, m1, m2, m3, m4, m5, m6, m7] != *MAGIC || format != FORMAT {
        return Ok(Err(
            "it was not written by this version of formica".to_owned()
        ));
    }
    let size = u64::from_le_bytes(size);
    if size > LONGEST || size > length.saturating_sub(START as u64) {
        return Ok(Err("it is truncated".to_owned()));
    }
    Read::by_ref(file).take(size).read_to_end(&mut head)?;
    let checksum = crc32fast::hash(head.get(CHECKED..).unwrap_or_default());
    if checksum != u32::from_le_bytes([c0, c1, c2, c3]) {
        return Ok(Err("the checksum of its header does not match".to_owned()));
    }
    let text = head.get(START..).unwrap_or_default();
    Ok(match postcard::from_bytes::<Description>(text) {
        Ok(description) => whole(&description, length).map(|()| description),
        Err(_) => Err("its header cannot be decoded".to_owned()),
    })
}

/// Checks a description against the length of its file.
fn whole(description: &Description, length: u64) -> Result<(), String> {
    if length != description.length {
        let wanted = description.length;
        return Err(format!("it has {length} bytes, not {wanted}"));
    }
    let inside = |section: &Section| {
        section.start.is_multiple_of(ALIGNMENT)
            && section.size > 0
            && section.bytes.is_multiple_of(section.size)
            && section
                .start
                .checked_add(section.bytes)
                .is_some_and(|end| end <= length)
    };
    match description.sections.iter().find(|section| !inside(section)) {
        Some(section) => Err(format!("its array '{}' is out of bounds", section.name)),
        None => Ok(()),
    }
}
