"""What a case is made of: a registry, a folder of its own, the binary, and what is asserted of an outcome.

A module of this folder holds the cases of one kind:

    from harness import case

    @case("Minari#304")                      # the public report that the case was made from
    def a_data_set_of_another_maze_is_refused(bench):
        bench.write("c.toml", CONFIG)
        bench.formica("check", "c.toml").fails(2, "rows inside walls", "medium")
"""
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import threading

CASES = []
# A command that takes longer hangs (s).
PATIENCE = 90
# What no command may ever print.
FORBIDDEN = re.compile(r"panicked|RUST_BACKTRACE|NaN| inf |(?<![\w.-])-0(\.0+)?(?![\w.])")

# A run of every part, too short to score well.
SMALL = """[maze]
layout = "umaze"
[dataset]
path = "data.hdf5"
[collect]
transitions = 12000
[encoder]
updates = 400
hidden = [32, 32]
[graph]
nodes = 20
refresh_seconds = 1.0
[low]
updates = 600
hidden = [32, 32]
[high]
steps = 40000
environments = 64
minibatch = 1024
[evaluation]
episodes = 8
max_steps = 300
[rollouts]
seconds = 2.0
[traces]
training_every = 5
"""


def case(source):
    """Registers a case; `source` is the public report, or "-"."""

    def register(function):
        CASES.append((function.__module__, function.__name__, source, function))
        return function

    return register


class Outcome:
    """How a command ended: exit code (negative: by that signal) and what it printed."""

    def __init__(self, command, code, out, err):
        self.command, self.code, self.out, self.err = command, code, out, err
        self.text = out + err
        word = FORBIDDEN.search(self.text)
        assert not word, f"'{word[0]}' is printed\n{self}"

    def __str__(self):
        return f"$ {' '.join(map(str, self.command))}\nexit code {self.code}\n{self.text}"

    def says(self, *words):
        for word in words:
            assert word in self.text, f"'{word}' is not said\n{self}"
        return self

    def never_says(self, *words):
        for word in words:
            assert word not in self.text, f"'{word}' is said\n{self}"
        return self

    def succeeds(self, *words):
        assert self.code == 0, f"it should succeed\n{self}"
        return self.says(*words)

    def fails(self, code, *words):
        assert self.code == code, f"it should end with exit code {code}\n{self}"
        return self.says(*words)


class Bench:
    """A folder of its own for a case, and the binary."""

    _small = None
    _lock = threading.Lock()

    def __init__(self, binary, folder):
        self.binary, self.folder = str(binary), pathlib.Path(folder)

    def write(self, name, text):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    def formica(self, *arguments, **options):
        """Runs `formica ARGUMENTS` to its end."""
        return self.command(self.binary, *arguments, **options)

    def shell(self, script, **options):
        """Runs a script of bash in which $F is the binary."""
        return self.command("bash", "-c", script, **options)

    def command(self, *command, cwd=None, env=None, timeout=PATIENCE):
        command = [str(word) for word in command]
        environment = {**os.environ, "F": self.binary, **(env or {})}
        environment = {key: value for key, value in environment.items() if value is not None}
        process = subprocess.Popen(
            command, cwd=cwd or self.folder, env=environment, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        )
        try:
            out, err = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            out, err = process.communicate()
            text = (out + err).decode(errors="replace")
            raise AssertionError(f"$ {' '.join(command)}\nno end within {timeout} s\n{text}") from None
        return Outcome(command, process.returncode, out.decode(errors="replace"), err.decode(errors="replace"))

    def small_run(self):
        """Copies a finished small run, its data set and its config into the folder: small.toml, data.hdf5, runs/small."""
        with Bench._lock:
            if Bench._small is None:
                Bench._small = tempfile.TemporaryDirectory(prefix="formica-cases-")
                first = Bench(self.binary, Bench._small.name)
                first.write("small.toml", SMALL)
                first.formica("launch", "small.toml").succeeds()
        shutil.copytree(Bench._small.name, self.folder, symlinks=True, dirs_exist_ok=True)
        return self.folder / "runs" / "small"
