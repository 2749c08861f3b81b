"""Traces: any file that the format allows is read; of a damaged one all that is whole is kept."""
import io
import json
import os
import random
import struct

from harness import case

CHUNK, MESSAGE, ATTACHMENT, FOOTER = 6, 5, 9, 2


class Trace:
    """A trace of a small run, and the same written in other ways."""

    def __init__(self, bench):
        from mcap.reader import make_reader

        self.bench = bench
        bench.small_run()
        self.name = "runs/small/traces/episode-0000.mcap"
        self.raw = (bench.folder / self.name).read_bytes()
        reader = make_reader(io.BytesIO(self.raw))
        self.summary = reader.get_summary()
        self.metadata = list(reader.iter_metadata())
        self.attachments = list(reader.iter_attachments())
        self.messages = list(reader.iter_messages(log_time_order=False))
        self.steps = sum(channel.topic == "/step" for _, channel, _ in self.messages)

    def write(self, name, order=None, extra=None, metadata=1, attachments=True, schemas=True, skip=0, **options):
        """Writes it with PyPI's writer; `extra` is called with it before the messages."""
        from mcap.writer import Writer

        out = io.BytesIO()
        writer = Writer(out, **options)
        writer.start(profile="", library="case")
        for _ in range(skip):
            writer.register_channel(f"/unused/{_}", "json", 0)
        ids = {}
        for old, channel in self.summary.channels.items():
            schema = self.summary.schemas[channel.schema_id]
            schema = writer.register_schema(schema.name, schema.encoding, schema.data) if schemas else 0
            ids[old] = writer.register_channel(channel.topic, channel.message_encoding, schema)
        for record in self.metadata * metadata:
            writer.add_metadata(record.name, record.metadata)
        for a in self.attachments if attachments else []:
            writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        if extra:
            extra(writer)
        for _, channel, message in order or self.messages:
            writer.add_message(ids[channel.id], message.log_time, message.data, message.publish_time, message.sequence)
        writer.finish()
        self.bench.write(name, out.getvalue())
        return out.getvalue()

    def is_the_same(self, name):
        """Inspect and replay take it for what it is, and nothing is lost in recovering it."""
        told = json.loads(self.bench.formica("inspect", "--json", name).succeeds().out)
        whole = json.loads(self.bench.formica("inspect", "--json", self.name).succeeds().out)
        assert told == whole, f"{name} tells another story\n{told}\n{whole}"
        self.bench.formica("inspect", name).succeeds(f"in {self.steps} steps").never_says("cut off", "damaged")
        self.bench.formica("replay", name).succeeds(f"{self.steps + 1} states", "the same bit for bit")
        self.bench.formica("recover", name, "--out", f"copy-of-{name}").succeeds("nothing was lost")
        read(self.bench.folder / f"copy-of-{name}")


def read(path):
    """The messages of a file by the official reader, its checksums held; topic, sequence, time, data."""
    from mcap.reader import make_reader
    from mcap.stream_reader import StreamReader

    with open(path, "rb") as file:
        for _ in StreamReader(file, validate_crcs=True).records:
            pass
        file.seek(0)
        messages = make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)
        return [(channel.topic, m.sequence, m.log_time, m.data) for _, channel, m in messages]


def records(raw):
    """Where records are: first byte, one after the last, opcode."""
    at = 8
    while at < len(raw) - 8:
        end = at + 9 + struct.unpack("<Q", raw[at + 1 : at + 9])[0]
        yield at, end, raw[at]
        at = end


def chunks(raw):
    return [(at, end) for at, end, opcode in records(raw) if opcode == CHUNK]


def after_header(raw, more):
    end = next(records(raw))[1]
    return raw[:end] + more + raw[end:]


def record(opcode, body):
    return bytes([opcode]) + struct.pack("<Q", len(body)) + body


def of_chunks(raw, wanted):
    """Messages of some chunks, counted by the official reader's parts."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk, Message
    from mcap.stream_reader import breakup_chunk

    found = []
    for at, end in wanted:
        chunk = Chunk.read(ReadDataStream(io.BytesIO(raw[at + 9 : end])))
        found += [(m.sequence, m.log_time, m.data) for m in breakup_chunk(chunk) if isinstance(m, Message)]
    return found


@case("mcap#1374")
def messages_in_any_order_are_read(bench):
    trace = Trace(bench)
    by_topic = sorted(trace.messages, key=lambda m: (m[1].topic, m[2].log_time))
    trace.write("by-topic.mcap", order=by_topic)
    trace.is_the_same("by-topic.mcap")
    trace.write("backwards.mcap", order=trace.messages[::-1])
    trace.is_the_same("backwards.mcap")
    shuffled = random.Random(1).sample(trace.messages, len(trace.messages))
    trace.write("shuffled.mcap", order=shuffled, chunk_size=3000)
    trace.is_the_same("shuffled.mcap")


@case("mcap spec")
def chunks_compressions_and_indexes_are_as_anyone_likes(bench):
    from mcap.writer import CompressionType, IndexType

    trace = Trace(bench)
    bare = dict(index_types=IndexType.NONE, repeat_channels=False, repeat_schemas=False,
                use_statistics=False, use_summary_offsets=False)
    trace.write("zstd.mcap", compression=CompressionType.ZSTD, chunk_size=500)
    trace.write("none.mcap", compression=CompressionType.NONE, enable_crcs=False)
    trace.write("unchunked.mcap", use_chunking=False, **bare)
    trace.write("bare.mcap", chunk_size=1 << 30, **bare)
    trace.write("no-schemas.mcap", schemas=False, skip=400)
    trace.write("twice-told.mcap", metadata=2)
    for name in ("zstd", "none", "unchunked", "bare", "no-schemas", "twice-told"):
        trace.is_the_same(f"{name}.mcap")


@case("mcap PR 1655")
def large_records_and_those_of_others_are_no_matter(bench):
    from mcap.writer import CompressionType

    trace = Trace(bench)
    time = trace.messages[0][2].log_time
    clip = os.urandom(1 << 10) * (20 << 10)
    trace.write("clip.mcap", extra=lambda w: w.add_attachment(time, time, "clip.mp4", "video/mp4", clip))

    def foreign(writer):
        camera = writer.register_channel("/camera", "json", 0)
        writer.add_message(camera, time, b'{"data":"' + b"A" * (20 << 20) + b'"}', time)
        text = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        writer.add_message(writer.register_channel("/step", "cdr", text), time, b"\x00\x01\x00\x00", time)

    plain = trace.write("foreign.mcap", extra=foreign, compression=CompressionType.NONE)
    trace.write("foreign-zstd.mcap", extra=foreign, compression=CompressionType.ZSTD)
    plain = trace.write("odd.mcap", enable_crcs=False)
    empty_chunk = struct.pack("<QQQI", 0, 0, 0, 0) + struct.pack("<I", 0) + struct.pack("<Q", 0)
    odd = record(0x80, b"hello") + record(0x55, b"") + record(CHUNK, empty_chunk) * 2
    bench.write("odd.mcap", after_header(plain, odd))
    for name in ("clip", "foreign", "foreign-zstd", "odd"):
        trace.is_the_same(f"{name}.mcap")


@case("mcap#1434")
def cut_off_is_told_by_exit_code_and_replayed_as_far_as_it_goes(bench):
    trace = Trace(bench)
    small = trace.write("small.mcap", chunk_size=2000)
    for part in (30, 60, 90, 99):
        bench.write("cut.mcap", trace.raw[: len(trace.raw) * part // 100])
        bench.formica("inspect", "cut.mcap").fails(3, "cut off: it has no footer")
        bench.formica("replay", "cut.mcap").fails(3, "cut off")
        bench.write("small-cut.mcap", small[: len(small) * part // 100])
        bench.formica("replay", "small-cut.mcap").fails(3, "the same bit for bit")
        bench.formica("recover", "small-cut.mcap", "--force").fails(3, "cut off", "messages kept: ")
        read(bench.folder / "small-cut.cut.mcap")
        bench.formica("inspect", "small-cut.cut.mcap").succeeds()
        bench.formica("replay", "small-cut.cut.mcap").succeeds("the same bit for bit")
    for name, rest in (("magic", trace.raw[:-8]), ("half-magic", trace.raw[:-3]), ("zeros", trace.raw[: len(trace.raw) // 2] + bytes(9999))):
        bench.write(f"{name}.mcap", rest)
        bench.formica("inspect", f"{name}.mcap").fails(3, "cut off")
        bench.formica("replay", f"{name}.mcap").fails(3, "cut off")


@case("mcap#385")
def of_a_damaged_trace_every_whole_chunk_is_kept(bench):
    trace = Trace(bench)
    small = trace.write("small.mcap", chunk_size=2000)
    places = chunks(small)
    assert len(places) > 10
    dice = random.Random(7)
    for number in range(12):
        first = dice.randrange(len(places))
        from_, to = places[first][0] + dice.randrange(60), places[min(first + number % 3, len(places) - 1)][1] - dice.randrange(9)
        if to <= from_:
            to = from_ + 1
        junk = [bytes(to - from_), dice.randbytes(to - from_), b"", dice.randbytes(77)][number % 4]
        bad = small[:from_] + junk + small[to:]
        bench.write("bad.mcap", bad)
        outcome = bench.formica("recover", "bad.mcap", "--force")
        assert outcome.code == 3 and " are lost: " in outcome.text, f"bytes {from_} to {to}, way {number % 4}\n{outcome}"
        kept = read(bench.folder / "bad.cut.mcap")
        kept = {(sequence, time, data) for _, sequence, time, data in kept}
        whole = [place for place in places if place[1] <= from_ or place[0] >= to]
        missing = [m for m in of_chunks(small, whole) if m not in kept]
        assert not missing, f"{len(missing)} messages of whole chunks are missing, bytes {from_} to {to}"
        bench.formica("inspect", "bad.mcap").fails(3, "damaged").never_says("cut off:")
        bench.formica("inspect", "bad.cut.mcap").succeeds("recovered from a trace of which was lost")


@case("mcap#1474")
def a_bad_chunk_is_left_out_and_said_so(bench):
    trace = Trace(bench)
    places = chunks(trace.raw)
    at, end = places[len(places) // 2]
    bad = bytearray(trace.raw)
    bad[(at + end) // 2] ^= 0xFF
    bench.write("bad.mcap", bytes(bad))
    bench.formica("inspect", "bad.mcap").fails(3, f"bytes {at} to {end} are lost").never_says("cut off")
    bench.formica("replay", "bad.mcap").fails(3)
    bench.formica("recover", "bad.mcap").fails(3, f"bytes {at} to {end} are lost", "the chunk at byte")
    bad = bytearray(trace.raw)
    bad[-20] ^= 0xFF
    bench.write("footer.mcap", bytes(bad))
    bench.formica("inspect", "footer.mcap").fails(3, "the data are all there").never_says("cut off")
    bench.formica("replay", "footer.mcap").fails(3, f"{trace.steps + 1} states", "the same bit for bit")
    bench.write("trailing.mcap", trace.raw + b"\n")
    bench.formica("inspect", "trailing.mcap").fails(3, "1 bytes follow the end").never_says("cut off")


@case("mcap spec")
def an_unknown_compression_is_named(bench):
    from mcap.writer import CompressionType

    trace = Trace(bench)
    raw = trace.write("zstd.mcap", compression=CompressionType.ZSTD, enable_crcs=False)
    bench.write("brot.mcap", raw.replace(b"\x04\x00\x00\x00zstd", b"\x04\x00\x00\x00brot"))
    for command in ("inspect", "replay", "recover"):
        bench.formica(command, "brot.mcap").says("brot").never_says("cut off")


@case("-")
def what_is_no_trace_is_named_and_leaves_nothing(bench):
    trace = Trace(bench)
    bench.write("empty.mcap", b"")
    bench.write("magic.mcap", trace.raw[:8])
    bench.write("text.mcap", "hello\n")
    bench.write("gzip.mcap", b"\x1f\x8b\x08" + bytes(100))
    bench.write("version.mcap", trace.raw[:5] + b"1" + trace.raw[6:])
    trace.write("other.mcap", metadata=0)
    for name, told in (("empty", "empty"), ("magic", ""), ("text", "no MCAP"), ("gzip", "gunzip"), ("version", "version 1"), ("other", "no trace of an episode")):
        for command in ("inspect", "replay"):
            bench.formica(command, f"{name}.mcap").fails(1, f"{name}.mcap: ", told)
    for name in ("empty", "magic", "text", "gzip", "other"):
        before = sorted(os.listdir(bench.folder))
        bench.formica("recover", f"{name}.mcap").fails(1, f"{name}.mcap: nothing can be recovered")
        assert sorted(os.listdir(bench.folder)) == before, "something is left of it"
    bench.shell("$F inspect /dev/null").fails(1, "/dev/null: ", "device")
    bench.shell("mkfifo pipe; timeout 5 $F inspect pipe").fails(1, "pipe")


@case("mcap PR 1729")
def recover_writes_over_nothing(bench):
    trace = Trace(bench)
    raw = trace.raw[: len(trace.raw) // 2]
    bench.write("cut.mcap", raw)
    bench.write("there.mcap", "mine")
    bench.formica("recover", "cut.mcap", "--out", "there.mcap").fails(1, "there.mcap", "--force")
    assert (bench.folder / "there.mcap").read_text() == "mine"
    os.symlink("cut.mcap", bench.folder / "link.mcap")
    os.link(bench.folder / "cut.mcap", bench.folder / "hard.mcap")
    os.symlink("nowhere.mcap", bench.folder / "dangling.mcap")
    (bench.folder / "folder").mkdir()
    for out in ("cut.mcap", "./cut.mcap", "link.mcap", "hard.mcap", "folder"):
        for force in ((), ("--force",)):
            outcome = bench.formica("recover", "cut.mcap", "--out", out, *force)
            assert outcome.code in (1, 2), outcome
            assert (bench.folder / "cut.mcap").read_bytes() == raw, f"--out {out} wrote over the input"
    bench.formica("recover", "cut.mcap", "--out", "there.mcap", "--force").fails(3)
    read(bench.folder / "there.mcap")
    left = [name for name in os.listdir(bench.folder) if name.startswith(".")]
    assert not left, f"{left} is left"


@case("-")
def a_trace_is_named_by_path_folder_run_or_link(bench):
    trace = Trace(bench)
    os.symlink(bench.folder / "runs/small", bench.folder / "linked")
    os.symlink(trace.name, bench.folder / "one.mcap")
    for name in ("small", "latest", "runs/small", "runs/small/", "runs/small/traces", "linked", "./runs/latest"):
        bench.formica("inspect", name).succeeds("traces: ", "0 unreadable")
    for name in ("one.mcap", trace.name, "small/traces/episode-0000.mcap"):
        bench.formica("inspect", name).succeeds("episode 0 of the run small")
    bench.formica("replay", "small").succeeds("episode-0007.mcap", "the same bit for bit")
    bench.formica("recover", "small").succeeds("all traces are whole")
    bench.formica("inspect", "smal").fails(1, "there is no smal")
    os.symlink("gone.mcap", bench.folder / "old.mcap")
    bench.formica("inspect", "old.mcap").fails(1, "gone.mcap, which is not there")


@case("-")
def values_that_no_ant_has_give_sentences(bench):
    trace = Trace(bench)

    def floats(number, values):
        body = struct.pack(f"<{len(values)}f", *values)
        return bytes([number << 3 | 2]) + varint(len(body)) + body

    def varint(value):
        out = b""
        while value >= 128:
            out, value = out + bytes([value & 127 | 128]), value >> 7
        return out + bytes([value])

    def step(number, values, reward=b"", action=(0.0,) * 8):
        return b"\x10" + varint(number) + reward + floats(13, values) + floats(14, action)

    def with_steps(name, values):
        order = []
        for schema, channel, message in trace.messages:
            if channel.topic == "/step":
                message.data, kept = values(message.sequence), message.data
                order.append((schema, channel, type(message)(**{**vars(message)})))
                message.data = kept
            else:
                order.append((schema, channel, message))
        trace.write(name, order=order)

    nan, inf = float("nan"), float("inf")
    negative = b"\x10" + b"\xff" * 9 + b"\x01"
    for name, values in (
        ("nan", lambda i: step(i, [nan] * 29)),
        ("inf", lambda i: step(i, [inf, -inf] + [0.0] * 27, b"\x1d" + struct.pack("<f", inf))),
        ("zero", lambda i: step(i, [-0.0] * 29, b"\x1d" + struct.pack("<f", -0.0))),
        ("wide", lambda i: step(i, [1.0] * 111)),
        ("none", lambda i: step(i, [])),
        ("action", lambda i: step(i, [1.0] * 29, action=[nan] * 3)),
        ("negative", lambda i: negative + floats(13, [1.0] * 29)),
        ("junk", lambda i: b"\xff\xff\xff"),
    ):
        with_steps(f"{name}.mcap", values)
        assert bench.formica("inspect", f"{name}.mcap", "--picture", f"{name}.svg").code in (0, 3)
        bench.formica("inspect", "--json", f"{name}.mcap")
        assert bench.formica("replay", f"{name}.mcap").code in (1, 3)
    bench.formica("inspect", "wide.mcap").says("29 values of the simulator")
    bench.formica("inspect", "nan.mcap").says("tell no place")
    bench.formica("inspect", "junk.mcap").fails(3, "cannot be decoded")


@case("-")
def a_trace_of_another_version_says_so(bench):
    trace = Trace(bench)
    for entry in trace.metadata:
        if "formica" in entry.metadata:
            entry.metadata["formica"] = "9.9.9"
    trace.write("future.mcap")
    bench.formica("inspect", "future.mcap").succeeds("formica 9.9.9")
    bench.formica("replay", "future.mcap").succeeds("formica 9.9.9, whose physics may differ")


@case("-")
def a_size_that_a_file_claims_is_not_believed(bench):
    trace = Trace(bench)
    plain = trace.write("plain.mcap", enable_crcs=False)
    huge = struct.pack("<QQQI", 0, 0, 1 << 62, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", 4) + b"\0" * 4
    bench.write("huge.mcap", after_header(plain, record(CHUNK, huge)))
    bench.shell("ulimit -v 4000000; $F inspect huge.mcap").fails(3, "damaged", "would take")
    at = next(at for at, _, opcode in records(plain) if opcode == CHUNK)
    bench.write("long.mcap", plain[: at + 1] + struct.pack("<Q", 1 << 60) + plain[at + 9 :])
    bench.shell("ulimit -v 4000000; $F inspect long.mcap").never_says("allocat")
