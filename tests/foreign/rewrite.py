#!/usr/bin/env python3
"""Writes a trace anew with the official Python writer, its chunks compressed with zstd.

Usage: rewrite.py FROM TO      (pip install mcap)
"""

import sys

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer


def rewrite(source, target):
    reader, writer = make_reader(source), Writer(target, compression=CompressionType.ZSTD)
    writer.start(library="rewrite")
    summary, channels = reader.get_summary(), {}
    for old, channel in summary.channels.items():
        schema = summary.schemas[channel.schema_id]
        schema = writer.register_schema(schema.name, schema.encoding, schema.data)
        channels[old] = writer.register_channel(channel.topic, channel.message_encoding, schema)
    for record in reader.iter_metadata():
        writer.add_metadata(record.name, record.metadata)
    for record in reader.iter_attachments():
        writer.add_attachment(
            record.create_time, record.log_time, record.name, record.media_type, record.data
        )
    for _, channel, message in reader.iter_messages(log_time_order=False):
        writer.add_message(
            channels[channel.id],
            message.log_time,
            message.data,
            message.publish_time,
            message.sequence,
        )
    writer.finish()


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    with open(sys.argv[1], "rb") as source, open(sys.argv[2], "wb") as target:
        rewrite(source, target)
