"""Outputs: none destroys an input or another's output, and none that fails leaves anything behind."""
import os
import signal
import stat
import subprocess
import time

import datasets
import numpy as np
from harness import SMALL, case


def convert(bench, source, target, to="ogbench", *arguments):
    return bench.formica("dataset", "convert", source, target, "--to", to, *arguments)


def names(bench):
    return sorted(os.listdir(bench.folder))


@case("mcap PR 1729")
def an_input_is_never_the_output(bench):
    datasets.d4rl(bench.folder / "a.hdf5")
    os.link(bench.folder / "a.hdf5", bench.folder / "hard")
    os.symlink("a.hdf5", bench.folder / "soft")
    before = (bench.folder / "a.hdf5").read_bytes()
    for name in ("a.hdf5", "./a.hdf5", "hard", "soft"):
        for force in ((), ("--force",)):
            convert(bench, "a.hdf5", name, "ogbench", *force).fails(2, "is the input a.hdf5 itself")
    datasets.minari(bench.folder / "m")
    convert(bench, "m", "m/data/main_data.hdf5", "d4rl", "--force").fails(2, "is the input m itself")
    convert(bench, "m/data/main_data.hdf5", "m", "minari", "--force").fails(2, "is the input")
    assert (bench.folder / "a.hdf5").read_bytes() == before
    assert names(bench) == ["a.hdf5", "hard", "m", "soft"]


@case("zstd#1422")
def devices_pipes_and_folders_are_no_outputs(bench):
    datasets.d4rl(bench.folder / "a.hdf5")
    os.mkdir(bench.folder / "folder")
    os.mkfifo(bench.folder / "pipe")
    wanted = {"folder": "a folder", "folder/": "a folder", "pipe": "a pipe", "/dev/null": "a device", "/dev/stdout": "a pipe"}
    if os.geteuid() == 0:
        os.mknod(bench.folder / "null", 0o666 | stat.S_IFCHR, os.makedev(1, 3))
        wanted["null"] = "a device"
    for name, told in wanted.items():
        convert(bench, "a.hdf5", name, "ogbench", "--force").fails(2, told)
    convert(bench, "a.hdf5", "a.hdf5/x.npz").fails(2, "a.hdf5 is a file")
    assert stat.S_ISFIFO(os.stat(bench.folder / "pipe").st_mode)
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


@case("openadmet PR 530")
def a_slash_at_the_end_changes_nothing(bench):
    datasets.d4rl(bench.folder / "a.hdf5")
    convert(bench, "a.hdf5", "new/deep/out/", "minari").succeeds()
    convert(bench, "a.hdf5", "x.npz/").succeeds()
    bench.formica("dataset", "info", "new/deep/out").succeeds("Minari")
    bench.formica("dataset", "info", "x.npz").succeeds("OGBench")
    assert names(bench) == ["a.hdf5", "new", "x.npz"]


@case("mcap PR 1729")
def what_is_there_is_replaced_only_by_force(bench):
    data = datasets.d4rl(bench.folder / "a.hdf5")
    bench.write("x.npz", "mine")
    bench.write("m/notes.txt", "mine")
    convert(bench, "a.hdf5", "x.npz").fails(2, "x.npz is there already", "--force")
    convert(bench, "a.hdf5", "m", "minari", "--force").fails(2, "holds other files too")
    bench.write("x-val.npz", "mine")
    convert(bench, "a.hdf5", "y.npz", "ogbench").succeeds()
    convert(bench, "a.hdf5", "x.npz", "ogbench", "--force").succeeds()
    datasets.same(datasets.read(bench, "x.npz"), data)
    os.unlink(bench.folder / "x.npz")
    convert(bench, "a.hdf5", "x.npz", "ogbench", "--val-share", "0.5").fails(2, "x-val.npz is there already")
    assert (bench.folder / "x-val.npz").read_text() == "mine"
    assert not (bench.folder / "x.npz").exists()
    convert(bench, "a.hdf5", "n", "minari").succeeds()
    convert(bench, "a.hdf5", "n", "minari", "--force").succeeds()


@case("mcap PR 1729")
def files_beside_an_output_are_left(bench):
    datasets.d4rl(bench.folder / "a.hdf5")
    bench.write("x.npz.part", "mine")
    bench.write("m.part/mine", "mine")
    convert(bench, "a.hdf5", "x.npz").succeeds()
    convert(bench, "a.hdf5", "m", "minari").succeeds()
    assert (bench.folder / "x.npz.part").read_text() == "mine"
    assert (bench.folder / "m.part/mine").read_text() == "mine"
    bench.formica("dataset", "convert", "--to", "ogbench", "--", "a.hdf5", "-x.npz").succeeds()
    assert names(bench) == ["-x.npz", "a.hdf5", "m", "m.part", "x.npz", "x.npz.part"]


@case("mcap PR 1729")
def collect_replaces_only_by_force(bench):
    bench.write("c.toml", SMALL.replace("12000", "1000"))
    bench.formica("collect", "c.toml").succeeds()
    before = os.stat(bench.folder / "data.hdf5")
    bench.formica("collect", "c.toml").fails(2, "data.hdf5 is there already", "--force")
    assert os.stat(bench.folder / "data.hdf5").st_mtime_ns == before.st_mtime_ns
    bench.formica("collect", "c.toml", "--force").succeeds()
    bench.formica("collect", "c.toml", "--set", "dataset.path=new/deep/d.hdf5").succeeds()
    bench.formica("collect", "c.toml", "--set", "dataset.path=c.toml", "--force").fails(2, "is the input c.toml itself")
    assert names(bench) == ["c.toml", "data.hdf5", "new"]


@case("mcap PR 1729")
def two_writers_leave_one_sound_file(bench):
    bench.write("c.toml", SMALL)
    command = [bench.binary, "collect", "c.toml"]
    both = [subprocess.Popen(command, cwd=bench.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) for _ in range(2)]
    told = [process.communicate(timeout=80)[0] for process in both]
    codes = sorted(process.returncode for process in both)
    assert codes[0] == 0 and codes[1] != 101, (codes, told)
    if codes[1] != 0:
        assert any("data.hdf5 was made by another process meanwhile" in text or "is there already" in text for text in told), told
    bench.formica("dataset", "info", "data.hdf5").succeeds("D4RL HDF5")
    assert names(bench) == ["c.toml", "data.hdf5"]


@case("-")
def a_signal_leaves_nothing_behind(bench):
    data = datasets.rows()
    many = {key: np.concatenate([values] * 1200) for key, values in data.items()}
    datasets.d4rl(bench.folder / "a.hdf5", many)
    for number, wanted in ((signal.SIGINT, "m"), (signal.SIGTERM, "x.npz")):
        to = "minari" if wanted == "m" else "ogbench"
        process = subprocess.Popen([bench.binary, "dataset", "convert", "a.hdf5", wanted, "--to", to], cwd=bench.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        # Until something is staged, or it is over.
        while process.poll() is None and len(names(bench)) < 2:
            time.sleep(0.001)
        process.send_signal(number)
        process.communicate(timeout=60)
        left = set(names(bench)) - {"a.hdf5"}
        assert left <= {wanted}, left
        if process.returncode != 0:
            assert not left, left
