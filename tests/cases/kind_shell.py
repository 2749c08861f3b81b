"""Life in a shell: signals, pipes, terminals, full disks, and a binary that is replaced."""
import re

from harness import SMALL, case

# A run of every part, as short as it can be.
QUICK = SMALL
for long, short in (("transitions = 12000", "transitions = 6000"), ("updates = 400", "updates = 100"),
                    ("updates = 600", "updates = 100"), ("steps = 40000", "steps = 8000"),
                    ("episodes = 8", "episodes = 2"), ("seconds = 2.0", "seconds = 0.5")):
    assert long in QUICK, long
    QUICK = QUICK.replace(long, short)

# Every command in a folder with a finished small run, by what it is given.
COMMANDS = """
--version
--help
launch --help
check small.toml
dataset info data.hdf5
curves small --force
inspect runs/small
inspect --json runs/small
replay runs/small/traces/episode-0000.mcap
report small --out r.html --force
doctor
""".strip().splitlines()


@case("fd#24, xan#759")
def a_reader_that_is_gone_ends_no_command_with_a_panic(bench):
    bench.small_run()
    for command in COMMANDS:
        # `true` reads nothing: the pipe is closed at once, or soon.
        plain = bench.shell(f"$F {command}").code
        told = bench.shell(f"$F {command} 2>err | true; echo ${{PIPESTATUS[0]}}; cat err")
        assert told.out == f"{plain}\n", f"{command}\n{told}"


@case("coreutils")
def a_full_disk_is_one_sentence_and_exit_code_1(bench):
    bench.small_run()
    for command in COMMANDS:
        told = bench.shell(f"$F {command} >/dev/full")
        assert told.code == 1 and len(told.err.splitlines()) == 1, f"{command}\n{told}"
        told.says("formica: standard output cannot be written: No space left on device")
        # With standard error on it too, nothing can be said.
        assert bench.shell(f"$F {command} >/dev/full 2>&1").code == 1, command


@case("rust#46016")
def closed_descriptors_are_no_files_of_a_run(bench):
    bench.small_run()
    for command in COMMANDS:
        plain = bench.shell(f"$F {command}").code
        for closed in (">&-", "2>&-", "<&-", ">&- 2>&- <&-"):
            told = bench.shell(f"$F {command} {closed}")
            assert told.code == plain, f"{command} {closed}\n{told}"


@case("fd#24")
def a_launch_whose_output_is_not_read_goes_on_to_its_score(bench):
    bench.write("small.toml", QUICK)
    for name, to in (("head", "| head -1"), ("full", ">/dev/full 2>/dev/full")):
        told = bench.shell(f"$F launch small.toml --set run.name={name} {to}; exit ${{PIPESTATUS[0]}}")
        assert told.code == 0, told
        assert (bench.folder / "runs" / name / "score.json").is_file(), told


@case("-")
def a_pipe_that_is_full_holds_no_run_up(bench):
    bench.write("small.toml", QUICK)
    # The reader takes nothing until the run is over, and the pipe holds a page.
    told = bench.command("python3", "-c", """
import fcntl, os, subprocess, sys
reader, writer = os.pipe()
fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
os.set_blocking(writer, False)
while True:
    try:
        os.write(writer, b"x" * 256)
    except BlockingIOError:
        break
os.set_blocking(writer, True)
run = subprocess.run([os.environ["F"], "launch", "small.toml"], stdout=writer, stderr=writer, timeout=80)
print(run.returncode, os.path.exists("runs/small/score.json"))
""")
    assert told.out == "0 True\n", told


@case("pytorch#67538")
def nohup_keeps_a_run_alive_when_its_terminal_is_gone(bench):
    bench.write("small.toml", QUICK)
    told = bench.shell(
        """nohup $F launch small.toml >log 2>&1 & run=$!
        until grep -q '^train' log; do sleep 0.05; done
        kill -HUP $run; wait $run; echo $?"""
    )
    assert told.out == "0\n", f"{told}\n{(bench.folder / 'log').read_text()}"
    assert (bench.folder / "runs/small/score.json").is_file()


@case("pytorch#67538")
def nohup_keeps_a_collection_alive(bench):
    bench.write("small.toml", QUICK.replace("6000", "20000"))
    told = bench.shell(
        """nohup $F collect small.toml >log 2>&1 & run=$!
        sleep 0.4; kill -HUP $run; kill -INT $run; wait $run; echo $?"""
    )
    # In a script a job in the background ignores SIGINT from the start.
    assert told.out == "0\n" and (bench.folder / "data.hdf5").is_file(), told


@case("rust#69343")
def a_binary_that_is_replaced_under_a_run_still_starts_its_processes(bench):
    bench.write("small.toml", QUICK.replace("seconds = 0.5", "seconds = 4.0"))
    told = bench.shell(
        """cp $F ./formica; ./formica launch small.toml >log 2>&1 & run=$!
        until grep -q '^train' log; do sleep 0.05; done
        echo '#!/bin/false' >new; chmod +x new; mv new formica
        pkill -KILL -P $run -f -- 'actor .*--id 0'; wait $run; echo $?"""
    )
    log = (bench.folder / "log").read_text()
    assert told.out == "0\n" and "restarts: 1" in log, f"{told}\n{log}"


@case("-")
def a_run_that_is_stopped_and_continued_goes_on_at_its_pace(bench):
    bench.write("small.toml", QUICK.replace("seconds = 0.5", "seconds = 5.0"))
    told = bench.shell(
        """$F launch small.toml --set actor.hung_seconds=2 --set learner.hung_seconds=2 \
          --set graph_builder.hung_seconds=2 >log 2>&1 & run=$!
        until grep -q 'steps/s' log; do sleep 0.05; done
        kill -STOP $run; sleep 4; kill -CONT $run; wait $run; echo $?"""
    )
    log = (bench.folder / "log").read_text()
    assert told.out == "0\n" and "restarts" not in log, f"{told}\n{log}"
    rates = [float(rate) for rate in re.findall(r" at (\S+) steps/s", log)]
    assert rates and max(rates) < 1e5, f"{rates}\n{log}"


@case("gh-cli#1208, clig.dev")
def a_poor_environment_is_enough(bench):
    bench.small_run()
    for environment in (
        {"TERM": "dumb"},
        {"TERM": None},
        {"NO_COLOR": "1"},
        {"CI": "true"},
        {"HOME": None},
        {"PATH": ""},
        {"LANG": "C", "LC_ALL": "C"},
    ):
        for command in (["--help"], ["check", "small.toml"], ["inspect", "runs/small"], ["doctor"]):
            told = bench.formica(*command, env=environment)
            assert told.code == bench.formica(*command).code and "\x1b" not in told.text, told


@case("clap#4109")
def an_argument_that_is_no_text_is_refused(bench):
    bench.write("small.toml", QUICK)
    for command in (r"$'\xff'", r"launch --resume $'\xff'", r"check small.toml --set $'\xff=1'"):
        bench.shell(f"$F {command}").fails(2)
    # A path may be any bytes.
    bench.shell("cp small.toml $'\\xff.toml'; $F check $'\\xff.toml' --set run.name=x").succeeds()
