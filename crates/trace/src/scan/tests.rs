use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;

use mcap::Attachment;
use mcap::records::{MessageHeader, Metadata, Record, op};
use proptest::prelude::*;

use super::frame::Frame;
use super::*;
use crate::tests::made::episode_bytes;
use crate::{Recovered, Trace, TraceError, read_bytes, recover_bytes};

mod made;

use made::{
    Damage, Way, any_damage, any_way, contains, damaged, frames, record_of, rewritten, untouched,
};

const STEPS: u32 = 40;

/// A message: topic, sequence, log time, data.
type Told = (String, u32, u64, Vec<u8>);

/// All that a file holds.
#[derive(Default)]
struct Held {
    topics: BTreeMap<u16, String>,
    messages: Vec<(MessageHeader, Vec<u8>)>,
    metadata: Vec<Metadata>,
    attachments: Vec<Attachment<'static>>,
}

impl Visit for Held {
    type Error = String;

    fn wants(&self, _: u8, _: u16, _: u64) -> bool {
        true
    }

    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), String> {
        self.messages.push((*header, data.to_vec()));
        Ok(())
    }

    fn record(&mut self, record: Record<'_>) -> Result<(), String> {
        match record {
            Record::Metadata(metadata) => self.metadata.push(metadata),
            Record::Attachment { header, data, .. } => self.attachments.push(Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data: Cow::Owned(data.into_owned()),
            }),
            _ => {}
        }
        Ok(())
    }
}

impl Held {
    fn told(&self) -> Vec<Told> {
        let told = self.messages.iter().map(|(header, data)| {
            let topic = self
                .topics
                .get(&header.channel_id)
                .cloned()
                .unwrap_or_default();
            (topic, header.sequence, header.log_time, data.clone())
        });
        let mut told: Vec<Told> = told.collect();
        told.sort();
        told
    }
}

fn scanned(bytes: &[u8]) -> (Scan<Cursor<&[u8]>>, Held) {
    let mut scan = Scan::of(Cursor::new(bytes)).unwrap();
    let topics = scan.channels.iter();
    let mut held = Held {
        topics: topics
            .map(|(id, channel)| (*id, channel.topic.clone()))
            .collect(),
        ..Held::default()
    };
    assert!(scan.visit(&mut held).is_ok());
    (scan, held)
}

fn read(bytes: &[u8]) -> Result<Trace, TraceError> {
    read_bytes(Path::new("made"), bytes)
}

fn recovered(bytes: &[u8]) -> Result<(Recovered, Vec<Told>), TraceError> {
    let (recovered, written) = recover_bytes(Path::new("made"), bytes)?;
    let (scan, held) = scanned(&written);
    assert!(scan.cut.is_none() && scan.lost.is_empty() && scan.notes.is_empty());
    // What no checksum covers may be a message all the same, and of nonsense.
    let nonsense =
        |told: &String| told.contains("cannot be decoded") || told.contains("its metadata tell");
    assert!(read(&written).unwrap().damage.iter().all(nonsense));
    Ok((recovered, held.told()))
}

fn check_damage(bytes: &[u8], damage: Damage, at: usize, len: usize) {
    let (from, to) = (at % bytes.len(), (at % bytes.len() + len).min(bytes.len()));
    let touched = match damage {
        // It splits the record that it falls into.
        Damage::Inserted => (from as u64, from as u64 + 1),
        _ => (from as u64, to as u64),
    };
    let bad = damaged(bytes, damage, from, to);
    let wanted = untouched(bytes, touched.0, touched.1);
    let steps = wanted
        .iter()
        .any(|(topic, ..)| topic == "/step" || topic == "/start");
    match recovered(&bad) {
        Ok((recovered, kept)) => {
            let missing = wanted.len() - kept.len().min(wanted.len());
            assert!(
                contains(&kept, &wanted),
                "{missing} are missing: {recovered:?}"
            );
        }
        Err(TraceError::Nothing { .. }) if !steps => {}
        Err(error) => panic!("{error}"),
    }
}

proptest! {
    #[test]
    fn however_an_episode_is_written_it_reads_the_same(way in any_way()) {
        let bytes = episode_bytes(STEPS);
        let rewritten = rewritten(&bytes, &way);
        let (told, again) = (read(&bytes).unwrap(), read(&rewritten).unwrap());
        prop_assert!(again.is_whole(), "{:?} {:?}", again.cut, again.damage);
        prop_assert_eq!(told, again);
        let (recovered, _) = recovered(&rewritten).unwrap();
        prop_assert!(recovered.was_whole());
    }

    #[test]
    fn of_any_damaged_file_every_chunk_beside_the_damage_is_recovered(
        damage in any_damage(),
        at in any::<usize>(),
        len in prop_oneof![1..20_usize, 1..6000_usize],
    ) {
        check_damage(&episode_bytes(STEPS), damage, at, len);
    }

    #[test]
    fn and_every_message_outside_of_chunks(
        damage in any_damage(),
        at in any::<usize>(),
        len in prop_oneof![1..20_usize, 1..6000_usize],
        summary in any::<bool>(),
    ) {
        let way = Way {
            chunks: None,
            compression: None,
            summary,
            checksums: true,
            first_channel: 1,
            schemas: true,
            order: 2,
        };
        let bytes = rewritten(&episode_bytes(10), &way);
        // Without a summary nothing but the channels themselves describes what follows.
        let described = frames(&bytes).iter().filter(|f| f.opcode == op::CHANNEL).map(Frame::end).max();
        let first = if summary { 0 } else { described.unwrap_or(0) as usize };
        let at = first + at % (bytes.len() - first);
        check_damage(&bytes, damage, at, len);
    }

    #[test]
    fn wherever_a_file_is_cut_off_every_chunk_before_is_recovered(
        at in any::<usize>(),
        way in any_way(),
    ) {
        let bytes = rewritten(&episode_bytes(15), &Way { order: 2, ..way });
        let at = at % bytes.len();
        let cut = &bytes[..at];
        let wanted = untouched(&bytes, at as u64, u64::MAX);
        let steps = wanted.iter().any(|(topic, ..)| topic == "/step" || topic == "/start");
        match recovered(cut) {
            Ok((recovered, kept)) => {
                prop_assert!(recovered.cut.is_some());
                prop_assert!(contains(&kept, &wanted));
            }
            Err(TraceError::Nothing { .. }) => prop_assert!(!steps),
            Err(error) => prop_assert!(false, "{}", error),
        }
    }

    #[test]
    fn any_bytes_are_taken(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = read(&bytes);
        let behind = [mcap::MAGIC, &bytes[..]].concat();
        let _ = (read(&behind), recover_bytes(Path::new("made"), &behind));
    }
}

#[test]
fn what_others_put_into_a_file_is_no_matter() {
    let bytes = episode_bytes(STEPS);
    let told = read(&bytes).unwrap();
    let none = Way {
        chunks: Some(2000),
        compression: None,
        summary: false,
        checksums: false,
        first_channel: 9,
        schemas: true,
        order: 2,
    };
    let plain = rewritten(&bytes, &none);
    let first = frames(&plain)[0].end() as usize;
    let large = vec![b'x'; 20 << 20];
    let channel = |id: u16, topic: &[u8], encoding: &[u8]| {
        let text = |text: &[u8]| [&(text.len() as u32).to_le_bytes(), text].concat();
        [
            &id.to_le_bytes()[..],
            &[0; 2],
            &text(topic),
            &text(encoding),
            &[0; 4],
        ]
        .concat()
    };
    let message = |id: u16, data: &[u8]| [&id.to_le_bytes()[..], &[0; 20], data].concat();
    let empty_chunk = record_of(op::CHUNK, &[0; 40]);
    let foreign = [
        // Private records and such of later versions of the format.
        record_of(0x80, b"hello"),
        record_of(0x42, b""),
        record_of(op::CHANNEL, &channel(3, b"/camera", b"json")),
        record_of(op::MESSAGE, &message(3, &large)),
        // A topic of ours by its name alone.
        record_of(op::CHANNEL, &channel(65_535, b"/step", b"json")),
        record_of(op::MESSAGE, &message(65_535, b"{}")),
        empty_chunk.clone(),
        empty_chunk,
        // A field that a later version has at the end.
        record_of(
            op::CHANNEL,
            &[&*channel(4, b"/more", b"cdr"), b"new"].concat(),
        ),
    ];
    let with = [&plain[..first], &foreign.concat(), &plain[first..]].concat();
    let mut again = read(&with).unwrap();
    assert!(again.is_whole(), "{:?} {:?}", again.cut, again.damage);
    assert_eq!(again.messages.remove("/camera"), Some(1));
    assert_eq!(again.messages["/step"], u64::from(STEPS) + 1);
    assert_eq!((again.steps, again.times[0]), (told.steps, 0));
    let (recovered, kept) = recovered(&with).unwrap();
    assert!(recovered.was_whole());
    assert!(kept.iter().any(|(_, _, _, data)| data.len() == large.len()));
}

#[test]
fn cut_off_is_said_of_files_that_are() {
    let bytes = episode_bytes(STEPS);
    let of = |bytes: &[u8]| {
        let trace = read(bytes).unwrap();
        (trace.cut, trace.damage)
    };
    let len = bytes.len();
    for cut in [len - 1, len - 8, len - 20, len - 500, len / 2] {
        let (cut, damage) = of(&bytes[..cut]);
        assert!(cut.is_some() && damage.is_empty(), "{cut:?} {damage:?}");
    }
    let (cut, damage) = of(&[&bytes[..], b"\n"].concat());
    assert!(
        cut.is_none() && damage[0].starts_with("1 bytes follow the end"),
        "{damage:?}"
    );
    let middle = frames(&bytes)
        .into_iter()
        .filter(|f| f.opcode == op::CHUNK)
        .nth(3)
        .unwrap();
    let mut bad = bytes.clone();
    bad[middle.end() as usize - 10] ^= 1;
    let (cut, damage) = of(&bad);
    assert!(cut.is_none() && damage.len() == 1, "{cut:?} {damage:?}");
    assert!(
        damage[0].contains(&format!("bytes {} to {}", middle.at, middle.end())),
        "{damage:?}"
    );
    let mut bad = bytes.clone();
    bad[len - 15] ^= 1;
    let (cut, damage) = of(&bad);
    assert!(cut.is_none() && damage[0].contains("summary"), "{damage:?}");
}

#[test]
fn a_size_that_a_file_claims_is_not_believed() {
    let bytes = episode_bytes(5);
    let first = frames(&bytes)[0].end() as usize;
    let mut zeros = zstd::bulk::compress(&vec![0; 8 << 20], 1).unwrap();
    let head = |size: u64, name: &str, data: &[u8]| {
        let mut body = vec![0; 16];
        body.extend(size.to_le_bytes());
        body.extend([0; 4]);
        body.extend((name.len() as u32).to_le_bytes());
        body.extend(name.as_bytes());
        body.extend((data.len() as u64).to_le_bytes());
        body.extend(data);
        record_of(op::CHUNK, &body)
    };
    zeros.truncate(zeros.len() - 1);
    for (chunk, told) in [
        (head(u64::MAX, "zstd", &zeros), "would take"),
        (head(1 << 20, "", &[5; 40]), "does not end"),
        (head(8 << 20, "zstd", &zeros), "does not end"),
        (head(40, "brot", &[5; 40]), "'brot'"),
        // Zeros where a chunk was.
        (record_of(op::CHUNK, &[0; 300]), "holds less"),
        (record_of(op::CHUNK, &[0xff; 60]), "damaged"),
        (record_of(op::ATTACHMENT, &[0; 3]), "damaged"),
        (record_of(op::ATTACHMENT, &[0; 9]), "damaged"),
        (record_of(op::SCHEMA, &[0xff; 30]), "damaged"),
    ] {
        let bad = [&bytes[..first], &*chunk, &bytes[first..]].concat();
        let trace = read(&bad).unwrap();
        assert_eq!((trace.steps.len(), &trace.cut), (5, &None));
        let place = format!("bytes {first} to {}", first + chunk.len());
        assert!(trace.damage[0].starts_with(&place), "{:?}", trace.damage);
        assert!(trace.damage[0].contains(told), "{told}: {:?}", trace.damage);
    }
}
