//! Files that hold the same in other ways, and damaged ones.

use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use proptest::prelude::*;

use super::*;

/// How a file is written anew.
#[derive(Debug, Clone)]
pub(super) struct Way {
    pub(super) chunks: Option<u64>,
    pub(super) compression: Option<Compression>,
    /// Summary, statistics, indexes and repeated descriptions, or none of them.
    pub(super) summary: bool,
    pub(super) checksums: bool,
    pub(super) first_channel: u16,
    pub(super) schemas: bool,
    /// Topics, times backwards, or a shuffle by this seed.
    pub(super) order: u64,
}

pub(super) fn any_way() -> impl Strategy<Value = Way> {
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
pub(super) fn rewritten(bytes: &[u8], way: &Way) -> Vec<u8> {
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
pub(super) fn record_of(opcode: u8, body: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

/// All frames of a sound file, from its first record on.
pub(super) fn frames(bytes: &[u8]) -> Vec<Frame> {
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
pub(super) fn untouched(bytes: &[u8], from: u64, to: u64) -> Vec<Told> {
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

pub(super) fn contains(all: &[Told], wanted: &[Told]) -> bool {
    let mut all = all.iter();
    wanted.iter().all(|wanted| all.any(|told| told == wanted))
}

/// Damage of one place: other bytes, bytes that are missing, or more of them.
#[derive(Debug, Clone, Copy)]
pub(super) enum Damage {
    Flipped(u8),
    Zeroed,
    Removed,
    Inserted,
}

pub(super) fn any_damage() -> impl Strategy<Value = Damage> {
    prop_oneof![
        (1_u8..).prop_map(Damage::Flipped),
        Just(Damage::Zeroed),
        Just(Damage::Removed),
        Just(Damage::Inserted)
    ]
}

pub(super) fn damaged(bytes: &[u8], damage: Damage, from: usize, to: usize) -> Vec<u8> {
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
