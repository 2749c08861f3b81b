"""Run files: every fault once, with file, line and key, whatever the file is."""
import os

from harness import case

REST = '[dataset]\npath = "x"\n[collect]\n'


def check(bench, text, *told):
    bench.write("c.toml", text)
    return bench.formica("check", "c.toml", timeout=5).fails(2, *told)


@case("telegraf#11945")
def numbers_that_do_not_fit(bench):
    check(bench, "[run]\nseed = -1\n" + REST, "c.toml:2: run.seed: -1 is out of range; 0 to 4294967295")
    check(bench, "[low]\nsnap = nan\n" + REST, "c.toml:2: low.snap: ", "nan")
    check(bench, "[low]\nsnap = inf\n" + REST, "c.toml:2: low.snap: expected a finite number")
    check(bench, "[run]\nseed = 1" + "0" * 300 + "\n" + REST, "c.toml:2: run.seed: ", "too large")
    check(bench, "[run]\nseed = 1.5\n" + REST, "c.toml:2: run.seed: expected a whole number, found the number 1.5")


@case("hydra#1163")
def text_keys_take_text_from_the_command_line(bench):
    bench.write("c.toml", REST)
    for name in ["2024-05-01", "true", "1.10", "12", "1e6"]:
        bench.formica("check", "c.toml", "--set", f"run.name={name}").succeeds(f"the run's name is {name}\n")
    for value in ["1e6", "1_000", "1000.0", "+1000"]:
        bench.formica("check", "c.toml", "--set", f"low.updates={value}").succeeds()
    bench.formica("check", "c.toml", "--set", "low.updates=10k").fails(2, 'found the text "10k"')
    bench.formica("check", "c.toml", "--set", "seed=3").fails(2, "run.seed")


@case("-")
def rows_without_a_layout_and_a_layout_without_rows(bench):
    check(bench, '[maze]\nlayout = "custom"\n' + REST, "c.toml:1: maze.rows: missing")
    check(bench, '[maze]\nrows = ["111"]\n' + REST, "c.toml:2: maze.rows: ", 'layout = "custom"')
    check(bench, '[low]\nhidden = [3, "a"]\n' + REST, 'item 2 of the list', 'the text "a"')


@case("-")
def other_languages_and_formats(bench):
    check(bench, "[run]\ndeterministic = True\n" + REST, "c.toml:2: 'True' is no value; did you mean true?")
    check(bench, "[encoder]\nfrom = None\n" + REST, "c.toml:2: 'None' is no value")
    check(bench, "[Maze]\n" + REST, "c.toml:1: Maze: unknown table; did you mean 'maze'?")
    check(bench, "[[run]]\n" + REST, "c.toml:1: run: expected one table")
    check(bench, "[run]\nseed = 1\nseed = 2\n" + REST, "c.toml:3: 'seed' is there already, in line 2")
    check(bench, "[run]\n[low]\n[run]\n" + REST, "c.toml:3: 'run' is there already, in line 1")
    check(bench, "maze:\n  layout: large\n", "c.toml: is YAML, not TOML")
    check(bench, '{"maze": 1}\n', "c.toml: is JSON, not TOML")


@case("-")
def encodings(bench):
    sound = "[run]\nseed = 3\n" + REST
    for text in [b"\xef\xbb\xbf" + sound.encode(), sound.replace("\n", "\r\n").encode()]:
        bench.write("c.toml", text)
        bench.formica("check", "c.toml").succeeds()
    for encoding in ["utf-16", "utf-16-le", "utf-16-be"]:
        check(bench, sound.encode(encoding), "c.toml: is UTF-16")
    check(bench, sound.replace("\n", "\r").encode(), "CR alone")
    check(bench, '[run]\n# Größe\n'.encode("latin-1") + REST.encode(), "c.toml:2: the byte 0xF6 is not UTF-8")
    check(bench, b"[run]\n\0" + REST.encode(), "c.toml:2: a zero byte")
    check(bench, b"", "c.toml:1: dataset.path: missing")


@case("-")
def what_is_no_file(bench):
    os.mkfifo(bench.folder / "pipe.toml")
    (bench.folder / "folder.toml").mkdir()
    bench.write("c.toml", REST)
    for path in ["pipe.toml", "/dev/zero", "/dev/stdin", "/dev/null"]:
        bench.formica("check", path, timeout=5).fails(2, "not a regular file")
    bench.shell('"$F" check <(cat c.toml)', timeout=5).fails(2, "not a regular file")
    bench.formica("check", "folder.toml", timeout=5).fails(2, "is a folder")
    bench.formica("check", "c", timeout=5).fails(2, "did you mean 'c.toml'?")
    bench.formica("check", "-", timeout=5).fails(2, "standard input")


@case("-")
def long_and_deep_files(bench):
    check(bench, "# " + "x" * (2 << 20), "longer than a run file may be")
    for text in ["run = " + "[" * 10000, "[" * 10000, "a." * 10000 + "b = 1", "run = " + "{a=" * 10000]:
        told = check(bench, text + "\n" + REST)
        assert len(told.text) < 10000, told
    told = check(bench, "".join(f"k{i} = = 1\n" for i in range(20000)))
    assert len(told.text.splitlines()) < 100, told
