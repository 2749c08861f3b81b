"""Messages: one sentence with its cause once, the path, and what to do next."""
import re

from harness import SMALL, case


@case("-")
def the_binary_names_itself(bench):
    told = bench.formica("--version").succeeds("formica ")
    assert re.fullmatch(r"formica \d+\.\d+\.\d+\n", told.out), told
    bench.formica("--help").succeeds("Usage: formica", "Exit codes:", "130")
    bench.formica().fails(2, "Usage: formica", "launch")


@case("-")
def a_system_error_is_told_once_with_its_path(bench):
    bench.small_run()
    for command, path in (
        (("check", "none.toml"), "none.toml"),
        (("launch", "none.toml"), "none.toml"),
        (("dataset", "info", "none.hdf5"), "none.hdf5"),
        (("replay", "none.mcap"), "none.mcap"),
        (("recover", "none.mcap"), "none.mcap"),
        (("curves", "small", "--out", "none/x.svg"), "none/x.svg"),
        (("report", "small", "--out", "none/x.html"), "none/x.html"),
        (("ceiling", "small.toml", "--walker", "none.safetensors"), "none.safetensors"),
        (("inspect", "runs/small/traces/episode-0000.mcap", "--picture", "none/x.svg"), "none/x.svg"),
    ):
        told = bench.formica(*command)
        assert told.code in (1, 2) and told.err.startswith("formica: "), told
        assert path in told.err and len(re.findall("[Nn]o such file|there is no", told.err)) == 1, told


@case("-")
def an_error_in_a_process_is_told_once_with_its_log(bench):
    bench.small_run()
    # A file that the learner reads once the run has begun.
    bench.write("bad.safetensors", b"not a parameter file")
    told = bench.formica("launch", "small.toml", "--set", "low.from=bad.safetensors")
    assert told.code in (1, 2), told
    told.says("learner-0", "bad.safetensors")
    assert len([line for line in told.text.splitlines() if "bad.safetensors" in line]) == 1, told
    assert "logs/learner-0.log" in told.err or told.code == 2, told


@case("-")
def logs_have_time_stamps(bench):
    run = bench.small_run()
    bench.shell("$F launch --resume small; true")
    for log in (run / "logs").glob("*.log"):
        for line in log.read_text().splitlines():
            assert re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z (INFO|WARN|ERROR) ", line), line


@case("-")
def a_run_without_success_names_its_weakest_stage_and_no_average(bench):
    bench.small_run()
    told = bench.formica("launch", "small.toml", "--set", "run.name=short", "--set", "evaluation.max_steps=5",
                         "--set", "evaluation.episodes=4")
    told.succeeds("0 of 4 episodes reached the goal;", "the weakest stage is ")
    told.never_says("on average", " - nats", "return -,")
