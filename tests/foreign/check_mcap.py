#!/usr/bin/env python3
"""Opens traces with the official Python reader and decodes every message.

Usage: check_mcap.py [--recovered] TRACE...      (pip install mcap mcap-protobuf-support)
With --recovered what a recovered trace may lack is not asked for.
Exit code: 0 all fine, 1 a trace is wrong, 2 usage.
"""

import sys
from collections import Counter

from mcap.reader import make_reader
from mcap.records import Chunk, DataEnd, Footer
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

METADATA = "formica.episode"
OUTCOME = "formica.outcome"
RECOVERED = "formica.recovered"


def check_records(path):
    """Every record of the file, all checksums held and none left out."""
    with open(path, "rb") as file:
        records = list(StreamReader(file, emit_chunks=True, validate_crcs=True).records)
    assert all(r.uncompressed_crc for r in records if isinstance(r, Chunk)), "a chunk has no checksum"
    assert all(r.data_section_crc for r in records if isinstance(r, DataEnd)), "the data have no checksum"
    assert [r.summary_crc for r in records if isinstance(r, Footer)] > [0], "the summary has no checksum"


def check_recovered(path):
    check_records(path)
    counts = Counter()
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        for _, channel, _, _ in reader.iter_decoded_messages(log_time_order=False):
            counts[channel.topic] += 1
        records = {record.name: record.metadata for record in reader.iter_metadata()}
        assert {METADATA, OUTCOME, RECOVERED} == set(records), f"metadata records {set(records)}"
        assert int(records[RECOVERED]["steps"]) == counts["/step"], "metadata and /step tell other counts"
        statistics = reader.get_summary().statistics
        assert statistics.message_count == counts.total(), "the statistics tell another count"
    print(path, counts.total(), records[RECOVERED]["lost"])


def check(path):
    check_records(path)
    counts, last, choices = Counter(), 0, []
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        # In the order of the file, so that an order that is wrong shows.
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            assert message.log_time >= last, f"time runs backwards on {channel.topic}"
            last = message.log_time
            counts[channel.topic] += 1
            if channel.topic == "/step":
                assert decoded.step == counts["/step"] - 1, f"step {decoded.step} out of order"
                assert len(decoded.observation) == 29, "an observation has 29 values"
                assert len(decoded.action) == 8, "an action has 8 values"
                time = decoded.timestamp.seconds * 10**9 + decoded.timestamp.nanos
                assert time == message.log_time, "the step's own time is its log time"
            elif channel.topic == "/tf":
                assert len(decoded.transforms) == 9, "the ant has nine bodies"
            elif channel.topic == "/choice":
                assert len(decoded.neighbours) == len(decoded.probabilities)
                assert abs(sum(decoded.probabilities) - 1) < 1e-3, "probabilities add up to 1"
                choices.append((decoded.step, decoded.subgoal_node))
            elif channel.topic == "/outcome":
                assert choices[-1] == (decoded.step - decoded.steps, decoded.subgoal_node)
            elif channel.topic.startswith("/points/"):
                assert len(decoded.data) % decoded.point_stride == 0 and decoded.data
        records = list(reader.iter_metadata())
        assert [record.name for record in records] == [METADATA, OUTCOME], records
        metadata = records[0].metadata | records[1].metadata
        for topic in ("/start", "/end", "/goal", "/graph/structure", "/scene/maze"):
            assert counts[topic] == 1, f"{counts[topic]} messages of {topic}"
        assert counts["/tf"] == counts["/step"] + 1, "a pose for each state"
        assert int(metadata["steps"]) == counts["/step"], "metadata and /step tell other counts"
        attachments = sorted(attachment.name for attachment in reader.iter_attachments())
        assert attachments == ["config.toml", "layout.json"], attachments
        statistics = reader.get_summary().statistics
        assert statistics.message_count == counts.total(), "the statistics tell another count"
        compression = {index.compression for index in reader.get_summary().chunk_indexes}
        assert compression == {"lz4"}, f"chunks compressed with {compression}"
    print(path)
    for topic, count in sorted(counts.items()):
        print(f"  {topic:14} {count}")
    for key, value in sorted(metadata.items()):
        print(f"  {key} = {value}")


def main():
    paths, checked = sys.argv[1:], check
    if paths[:1] == ["--recovered"]:
        paths, checked = paths[1:], check_recovered
    if not paths:
        print(__doc__, file=sys.stderr)
        return 2
    failed = False
    for path in paths:
        try:
            checked(path)
        except Exception as error:  # whatever the reader raises is a finding
            print(f"{path}: {type(error).__name__}: {error}", file=sys.stderr)
            failed = True
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
