//! Corrupt mapped files are refused, or the damage is in bytes that are never read.

use std::fs;

use super::*;

const FLOATS: [f32; 5] = [1.0, -2.5, 3.0, 0.0, 9.0];
const NUMBERS: [u64; 2] = [7, u64::MAX];

fn written(path: &Path) -> Vec<u8> {
    let arrays = [
        Values::new("floats", &FLOATS),
        Values::new::<u8>("none", &[]),
        Values::new("numbers", &NUMBERS),
        Values::new("bytes", b"abc"),
    ];
    write(path, "test", &("about", 3_u32), &arrays).unwrap();
    fs::read(path).unwrap()
}

/// Reads and compares everything that [`written`] wrote.
fn read(path: &Path) -> Result<(), MappedError> {
    let file = Mapped::open(path, "test")?;
    assert_eq!(file.about::<(String, u32)>()?, ("about".to_owned(), 3));
    assert_eq!(file.array::<f32>("floats")?, FLOATS);
    assert_eq!(file.array::<u64>("numbers")?, NUMBERS);
    assert!(file.array::<u8>("none")?.is_empty());
    assert_eq!(*file.array::<u8>("bytes")?, *b"abc");
    Ok(())
}

#[test]
fn arrays_round_trip() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.mapped");
    written(&path);
    read(&path).unwrap();
    let names: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(names.len(), 1);
    let file = Mapped::open(&path, "test").unwrap();
    let array = file.array::<f32>("floats").unwrap();
    // A mapping outlives its file's name.
    fs::remove_file(&path).unwrap();
    assert_eq!(array, FLOATS);
    for (name, told) in [("floats", "of another type"), ("gone", "is missing")] {
        let error = file.array::<u64>(name).unwrap_err().to_string();
        assert!(error.contains(told), "{error}");
    }
    let error = Mapped::open(&path, "test").unwrap_err().to_string();
    assert!(
        error.contains("x.mapped cannot be read: No such file"),
        "{error}"
    );
    assert!(error.ends_with("`formica launch --resume RUN` recreates it"));
}

#[test]
fn every_length_and_every_changed_byte_of_the_header_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.mapped");
    let whole = written(&path);
    for length in 0..whole.len() {
        fs::write(&path, &whole[..length]).unwrap();
        assert!(read(&path).is_err(), "cut at {length}");
    }
    fs::write(&path, [&whole[..], &[0]].concat()).unwrap();
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("bytes, not"), "{error}");
    let size = u64::from_le_bytes(whole[16..24].try_into().unwrap());
    let head = 24 + size as usize;
    for at in 0..head {
        for mask in [0x01, 0x80, 0xff] {
            let mut flipped = whole.clone();
            flipped[at] ^= mask;
            fs::write(&path, &flipped).unwrap();
            assert!(read(&path).is_err(), "byte {at} ^ {mask}");
        }
    }
    // The padding between the head and the first array is never read.
    let first = head.next_multiple_of(64);
    let mut padded = whole;
    padded[head..first].fill(0xff);
    fs::write(&path, &padded).unwrap();
    read(&path).unwrap();
}

/// Headers with a valid checksum and invalid sections.
#[test]
fn descriptions_that_do_not_fit_the_file_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.mapped");
    let section = |start, bytes, size| Section {
        name: "floats".to_owned(),
        size,
        start,
        bytes,
    };
    for sections in [
        vec![section(64, 4096, 4)],
        vec![section(u64::MAX - 63, 128, 4)],
        vec![section(96, 16, 4)],
        vec![section(64, 18, 4)],
        vec![section(64, 16, 0)],
    ] {
        let description = Description {
            kind: "test".to_owned(),
            about: vec![],
            sections,
            length: 256,
        };
        let mut bytes = header::headed(&description).unwrap();
        bytes.resize(256, 0);
        fs::write(&path, bytes).unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains("is out of bounds"), "{error}");
    }
}

#[test]
fn other_kinds_and_folders_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.mapped");
    write(&path, "other", &(), &[]).unwrap();
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("it contains 'other'"), "{error}");
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("it is not a file"), "{error}");
}

#[test]
fn a_failed_write_reports_the_space_needed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("gone/x.mapped");
    let arrays = [Values::new("floats", &FLOATS)];
    let error = write(&path, "test", &(), &arrays).unwrap_err().to_string();
    assert!(error.contains("x.mapped cannot be written: "), "{error}");
    assert!(error.contains("it needs 1 MB: make room"), "{error}");
    let limited = MappedError::Write {
        path,
        bytes: 5_000_000,
        source: io::ErrorKind::FileTooLarge.into(),
    };
    let told = limited.to_string();
    assert!(
        told.ends_with("it needs 5 MB: raise the limit with `ulimit -f`"),
        "{told}"
    );
}
