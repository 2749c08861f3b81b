//! A run file's text: read within bounds, or what the file is instead.

use std::fs::{self, File};
use std::io::{ErrorKind, Read};
use std::path::Path;

/// The longest run file (bytes).
const LONGEST: u64 = 1 << 20;

/// Reads the text of a file, without a byte order mark.
///
/// # Errors
/// A sentence that says what the file is instead, and the line of it where there is one.
pub(crate) fn read(path: &Path) -> Result<String, (usize, String)> {
    let whole = |message: String| (0, message);
    let about = fs::metadata(path).map_err(|error| whole(unreadable(path, &error)))?;
    if about.is_dir() {
        let message = match path.join("config.toml").is_file() {
            true => format!(
                "is a folder; `formica launch --resume {}` goes on with the run in it",
                path.display()
            ),
            false => "is a folder; name a run file".to_owned(),
        };
        return Err(whole(message));
    }
    // A pipe may keep its reader waiting, and a run is called by its file's name.
    if !about.is_file() {
        return Err(whole(
            "is not a regular file but a pipe or a device; write the config to a file first"
                .to_owned(),
        ));
    }
    let mut bytes = vec![];
    File::open(path)
        .and_then(|file| file.take(LONGEST + 1).read_to_end(&mut bytes))
        .map_err(|error| whole(unreadable(path, &error)))?;
    if bytes.len() as u64 > LONGEST {
        let message = format!(
            "is longer than a run file may be, {} MiB; is it another kind of file?",
            LONGEST >> 20
        );
        return Err(whole(message));
    }
    decode(&bytes)
}

fn unreadable(path: &Path, error: &std::io::Error) -> String {
    match error.kind() {
        ErrorKind::NotFound if path == Path::new("-") => {
            "a run file is not read from standard input; write it to a file first".to_owned()
        }
        ErrorKind::NotFound => {
            let mut with = path.as_os_str().to_owned();
            with.push(".toml");
            match Path::new(&with).is_file() {
                true => format!(
                    "there is no such file; did you mean '{}'?",
                    Path::new(&with).display()
                ),
                false => "there is no such file".to_owned(),
            }
        }
        _ => format!("cannot be read: {error}"),
    }
}

/// The bytes as text, or what they are instead.
fn decode(bytes: &[u8]) -> Result<String, (usize, String)> {
    let line = |at: usize| {
        let before = bytes.get(..at).unwrap_or_default();
        1 + before.iter().filter(|byte| **byte == b'\n').count()
    };
    let zeros = bytes.iter().filter(|byte| **byte == 0).count();
    let marked = bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]);
    if marked || (zeros >= 4 && (bytes.len() / 3..=bytes.len() / 2 + 1).contains(&zeros)) {
        return Err((0, "is UTF-16 text; save it as UTF-8".to_owned()));
    }
    if let Some(at) = bytes.iter().position(|byte| *byte == 0) {
        let message = "a zero byte; a run file is TOML text, is it another kind of file?";
        return Err((line(at), message.to_owned()));
    }
    let after_mark = bytes.strip_prefix(&[0xef, 0xbb, 0xbf]).unwrap_or(bytes);
    match std::str::from_utf8(after_mark) {
        Ok(text) if text.contains('\r') && !text.contains('\n') => Err((
            0,
            "its lines end in CR alone; save it with LF or CRLF".to_owned(),
        )),
        Ok(text) => Ok(text.to_owned()),
        Err(error) => {
            let at = error.valid_up_to();
            let byte = after_mark.get(at).copied().unwrap_or_default();
            let message = format!("the byte 0x{byte:02X} is not UTF-8; save the file as UTF-8");
            let mark = bytes.len() - after_mark.len();
            Err((line(mark + at), message))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn utf16(text: &str, big: bool) -> Vec<u8> {
        let units = text.encode_utf16();
        units
            .flat_map(|unit| match big {
                true => unit.to_be_bytes(),
                false => unit.to_le_bytes(),
            })
            .collect()
    }

    #[test]
    fn other_encodings_are_called_by_their_names() {
        let told = |bytes: &[u8]| decode(bytes).unwrap_err();
        for big in [false, true] {
            for text in ["[run]\nseed = 3\n", "\u{feff}[run]\nseed = 3\n"] {
                assert!(told(&utf16(text, big)).1.contains("UTF-16"), "{text}");
            }
        }
        let (line, message) = told(b"[run]\nname = \"b\xe4r\"\n");
        assert_eq!(line, 2);
        assert!(message.contains("0xE4 is not UTF-8"), "{message}");
        assert_eq!(told(b"[run]\nseed = \0\n").0, 2);
        assert!(told(b"[run]\rseed = 3\r").1.contains("CR alone"));
        assert_eq!(decode(b"\xef\xbb\xbf[run]\r\n").unwrap(), "[run]\r\n");
        assert_eq!(decode(&[]).unwrap(), "");
    }

    #[test]
    fn what_is_no_file_is_refused_without_waiting_for_it() {
        let folder = tempfile::tempdir().unwrap();
        let told = |path: &Path| read(path).unwrap_err().1;
        assert!(told(folder.path()).starts_with("is a folder; name"));
        fs::write(folder.path().join("config.toml"), "").unwrap();
        assert!(told(folder.path()).contains("--resume"));
        assert!(told(Path::new("/dev/zero")).contains("a pipe or a device"));
        assert!(told(Path::new("-")).contains("standard input"));
        let named = folder.path().join("config");
        assert!(told(&named).contains("did you mean"), "{}", told(&named));
        let long = folder.path().join("long.toml");
        fs::write(&long, vec![b'#'; (LONGEST + 1) as usize]).unwrap();
        assert!(told(&long).contains("longer than"));
    }
}
