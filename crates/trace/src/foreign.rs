//! Files that are none of MCAP, told by their first bytes.

/// What else begins so, and what to do about it.
const KINDS: [(&[u8], &str); 9] = [
    (
        b"\x1f\x8b",
        "it is compressed with gzip; decompress it first, with `gunzip`",
    ),
    (
        b"\x28\xb5\x2f\xfd",
        "it is compressed with zstd; decompress it first, with `unzstd`",
    ),
    (
        b"\x04\x22\x4d\x18",
        "it is compressed with lz4; decompress it first, with `unlz4`",
    ),
    (
        b"\xfd7zXZ\0",
        "it is compressed with xz; decompress it first, with `unxz`",
    ),
    (
        b"BZh",
        "it is compressed with bzip2; decompress it first, with `bunzip2`",
    ),
    (b"PK\x03\x04", "it is a zip archive; unpack it first"),
    (
        b"#ROSBAG ",
        "it is a bag of ROS 1; `mcap convert` makes MCAP of it",
    ),
    (
        b"SQLite f",
        "it is a database, as ROS 2 bags are; `mcap convert` makes MCAP of it",
    ),
    (
        b"\x89HDF\r\n\x1a\n",
        "it is HDF5, as data sets are; see `formica dataset info`",
    ),
];

/// Why a file that begins with these bytes is not read; `records`: whether whole records were found
/// in it all the same.
pub(crate) fn kind(beginning: &[u8], records: bool) -> Option<String> {
    if beginning.is_empty() {
        return Some("it is empty".to_owned());
    }
    if mcap::MAGIC.starts_with(beginning) {
        return None;
    }
    if let [
        0x89,
        b'M',
        b'C',
        b'A',
        b'P',
        version @ b'1'..=b'9',
        b'\r',
        b'\n',
    ] = beginning
    {
        let version = char::from(*version);
        let damaged = match records {
            true => "; if that byte is damaged, `formica recover` keeps the rest",
            false => "",
        };
        return Some(format!(
            "it is MCAP of version {version}, and formica reads version 0{damaged}"
        ));
    }
    if records {
        return None;
    }
    let known = KINDS.iter().find(|(bytes, _)| beginning.starts_with(bytes));
    Some(
        known
            .map_or("it is no MCAP file", |(_, told)| told)
            .to_owned(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_trace_is_named() {
        let told = |beginning: &[u8]| kind(beginning, false).unwrap_or_default();
        assert!(told(b"").contains("empty"));
        assert!(told(b"\x1f\x8b\x08\0\0\0\0\0").contains("gzip"));
        assert!(told(b"\x89MCAP1\r\n").contains("version 1"));
        assert!(told(b"hello\n").contains("no MCAP"));
        assert_eq!(kind(mcap::MAGIC, false), None);
        assert_eq!(kind(&mcap::MAGIC[..3], false), None);
        // Its first bytes are damaged, and what follows is not.
        assert_eq!(kind(b"\x89MCAP\0\r\n", true), None);
    }
}
