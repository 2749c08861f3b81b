use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions, Writer};
use proptest::prelude::*;

use super::*;
use crate::read::tests::episode_bytes;
use crate::{Recovered, Trace, TraceError, read_bytes, recover_bytes};

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

/// How a file is written anew.
#[derive(Debug, Clone)]
struct Way {
    chunks: Option<u64>,
    compression: Option<Compression>,
    /// Summary, statistics, indexes and repeated descriptions, or none of them.
    summary: bool,
    checksums: bool,
    first_channel: u16,
    schemas: bool,
    /// Topics, times backwards, or a shuffle by this seed.
    order: u64,
}

fn any_way() -> impl Strategy<Value = Way> {
    let compression = prop_oneof![
        Just(None),
        Just(Some(Compression::Lz4)),
        Just(Some(Compression::Zstd))
    ];
    let chunks = prop_oneof![Just(None), (64_u64..100_000).prop_map(Some)];
    let switches = (any::<bool>(), any::<bool>(), any::<bool>());
    (chunks, compression, switches, 0_u16..60_000, 0_u64..100).prop_map(
        |(chunks, compression, (summary, checksums, schemas), first_channel, order)| Way {
            chunks,
            compression,
            summary,
            checksums,
            first_channel,
            schemas,
            order,
        },
    )
}

fn ordered(held: &Held, order: u64) -> Vec<&(MessageHeader, Vec<u8>)> {
    let mut messages: Vec<_> = held.messages.iter().collect();
    match order {
        0 => messages.sort_by_key(|(header, _)| header.channel_id),
        1 => messages.reverse(),
        2 => {}
        seed => messages.sort_by_key(|(header, data)| {
            let mixed = header.log_time ^ u64::from(crc32fast::hash(data)) ^ seed;
            mixed.wrapping_mul(0x9e37_79b9_7f4a_7c15)
        }),
    }
    messages
}

/// The same episode, written in another way that the format allows.
fn rewritten(bytes: &[u8], way: &Way) -> Vec<u8> {
    let (scan, held) = scanned(bytes);
    let options = WriteOptions::new()
        .use_chunks(way.chunks.is_some())
        .chunk_size(way.chunks)
        .compression(way.compression)
        .emit_summary_records(way.summary)
        .emit_summary_offsets(way.summary)
        .emit_message_indexes(way.summary)
        .calculate_chunk_crcs(way.checksums)
        .calculate_data_section_crc(way.checksums)
        .calculate_summary_section_crc(way.checksums);
    let mut writer: Writer<_> = options.create(Cursor::new(vec![])).unwrap();
    held.attachments
        .iter()
        .for_each(|a| writer.attach(a).unwrap());
    held.metadata
        .iter()
        .for_each(|m| writer.write_metadata(m).unwrap());
    let mut ids = BTreeMap::new();
    for (id, channel) in &scan.channels {
        let schema = &scan.schemas[&channel.schema_id];
        let new = way.first_channel + id;
        let schema = match way.schemas {
            true => {
                let (name, encoding) = (&schema.name, &schema.encoding);
                writer.add_schema(name, encoding, &schema.data).unwrap()
            }
            false => 0,
        };
        let none = BTreeMap::new();
        writer
            .add_channel_with_id(new, schema, &channel.topic, "protobuf", &none)
            .unwrap();
        ids.insert(*id, new);
    }
    for (header, data) in ordered(&held, way.order) {
        let channel_id = ids[&header.channel_id];
        let header = MessageHeader {
            channel_id,
            ..*header
        };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// A record by hand.
fn record_of(opcode: u8, body: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

/// All frames of a sound file, from its first record on.
fn frames(bytes: &[u8]) -> Vec<Frame> {
    let mut source = Source::new(Cursor::new(bytes)).unwrap();
    let (mut at, mut frames) = (MAGIC, vec![]);
    while let Some(frame) = source.frame(at).unwrap() {
        at = frame.end();
        frames.push(frame);
    }
    assert_eq!(at + MAGIC, bytes.len() as u64);
    frames
}

/// The messages of those chunks, or messages outside of chunks, that bytes `from..to` do not touch.
fn untouched(bytes: &[u8], from: u64, to: u64) -> Vec<Told> {
    let (mut scan, whole) = scanned(bytes);
    let mut held = Held {
        topics: whole.topics,
        ..Held::default()
    };
    for frame in frames(bytes) {
        let of_interest = [op::CHUNK, op::MESSAGE].contains(&frame.opcode);
        if of_interest && (frame.end() <= from || frame.at >= to) {
            assert!(scan.visit_frame(&frame, &mut held).is_ok());
        }
    }
    held.told()
}

fn contains(all: &[Told], wanted: &[Told]) -> bool {
    let mut all = all.iter();
    wanted.iter().all(|wanted| all.any(|told| told == wanted))
}

/// Damage of one place: other bytes, bytes that are missing, or more of them.
#[derive(Debug, Clone, Copy)]
enum Damage {
    Flipped(u8),
    Zeroed,
    Removed,
    Inserted,
}

fn any_damage() -> impl Strategy<Value = Damage> {
    prop_oneof![
        (1_u8..).prop_map(Damage::Flipped),
        Just(Damage::Zeroed),
        Just(Damage::Removed),
        Just(Damage::Inserted)
    ]
}

fn damaged(bytes: &[u8], damage: Damage, from: usize, to: usize) -> Vec<u8> {
    let middle = &bytes[from..to];
    let middle: Vec<u8> = match damage {
        Damage::Flipped(bits) => middle.iter().map(|byte| byte ^ bits).collect(),
        Damage::Zeroed => vec![0; middle.len()],
        Damage::Removed => vec![],
        // Nothing is overwritten.
        Damage::Inserted => {
            let junk: Vec<u8> = (0..middle.len()).map(|i| (i * 7) as u8).collect();
            return [&bytes[..from], &junk, &bytes[from..]].concat();
        }
    };
    [&bytes[..from], &middle, &bytes[to..]].concat()
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

#[test]
fn seeds() {
    let Ok(folder) = std::env::var("SEEDS") else {
        return;
    };
    for (name, way) in [
        (
            "lz4",
            Way {
                chunks: Some(700),
                compression: Some(Compression::Lz4),
                summary: true,
                checksums: true,
                first_channel: 1,
                schemas: false,
                order: 2,
            },
        ),
        (
            "zstd-backwards",
            Way {
                chunks: Some(700),
                compression: Some(Compression::Zstd),
                summary: true,
                checksums: false,
                first_channel: 7,
                schemas: false,
                order: 1,
            },
        ),
        (
            "no-chunks",
            Way {
                chunks: None,
                compression: None,
                summary: true,
                checksums: false,
                first_channel: 1,
                schemas: false,
                order: 2,
            },
        ),
        (
            "plain-chunks",
            Way {
                chunks: Some(300),
                compression: None,
                summary: false,
                checksums: false,
                first_channel: 1,
                schemas: false,
                order: 0,
            },
        ),
    ] {
        let bytes = episode_bytes(3);
        let (scan, mut held) = scanned(&bytes);
        held.messages.retain(|(h, _)| {
            [
                "/start",
                "/step",
                "/choice",
                "/outcome",
                "/end",
                "/goal",
                "/graph/structure",
            ]
            .contains(&&*held.topics[&h.channel_id])
        });
        held.attachments.truncate(1);
        let mut writer: Writer<_> = WriteOptions::new()
            .use_chunks(way.chunks.is_some())
            .chunk_size(way.chunks)
            .compression(way.compression)
            .emit_summary_records(way.summary)
            .emit_summary_offsets(way.summary)
            .calculate_chunk_crcs(way.checksums)
            .calculate_data_section_crc(way.checksums)
            .calculate_summary_section_crc(way.checksums)
            .calculate_attachment_crcs(way.checksums)
            .create(Cursor::new(vec![]))
            .unwrap();
        held.attachments
            .iter()
            .for_each(|a| writer.attach(a).unwrap());
        held.metadata
            .iter()
            .for_each(|m| writer.write_metadata(m).unwrap());
        let mut ids = BTreeMap::new();
        for (id, channel) in &scan.channels {
            ids.insert(
                *id,
                writer
                    .add_channel_with_id(
                        id + way.first_channel,
                        0,
                        &channel.topic,
                        "protobuf",
                        &BTreeMap::new(),
                    )
                    .unwrap(),
            );
        }
        for (header, data) in ordered(&held, way.order) {
            let header = MessageHeader {
                channel_id: ids[&header.channel_id],
                ..*header
            };
            writer.write_to_known_channel(&header, data).unwrap();
        }
        writer.finish().unwrap();
        std::fs::write(format!("{folder}/{name}"), writer.into_inner().into_inner()).unwrap();
    }
}
