"""Data that do not fit a run are refused before it starts, with the figure; known other frames are converted."""
import pathlib
import time

import h5py
import numpy as np

from harness import case

# The centres of cells on the ways from start to goal (m), in D4RL's frame.
MEDIUM = [(0, 0), (0, 4), (4, 4), (4, 8), (8, 8), (12, 8), (12, 12), (16, 12), (20, 12), (20, 16), (20, 20)]
UMAZE = [(0, 0), (4, 0), (8, 0), (8, 4), (8, 8), (4, 8), (0, 8)]
CONFIG = """[maze]
layout = "%s"
[dataset]
path = "%s"
[encoder]
updates = 300
hidden = [32, 32]
[graph]
nodes = 12
refresh_seconds = 1.0
[low]
updates = 300
hidden = [32, 32]
[high]
steps = 20000
environments = 64
minibatch = 1024
[evaluation]
episodes = 2
max_steps = 100
[rollouts]
seconds = 1.0
"""


def walks(way, count=8, rows=150, seed=0):
    """Episodes to and fro along a way, as D4RL's flat arrays, by an ant of sound joints and velocities."""
    rng = np.random.default_rng(seed)
    points = np.asarray(way, float)
    at = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    parts = []
    for k in range(count):
        s = np.linspace(0, at[-1], rows)[:: -1 if k % 2 else 1]
        o = np.zeros((rows, 29))
        o[:, :2] = np.stack([np.interp(s, at, points[:, 0]), np.interp(s, at, points[:, 1])], 1)
        o[:, :2] += rng.normal(0, 0.02, (rows, 2))
        o[:, 2] = rng.normal(0.55, 0.02, rows)
        half = rng.uniform(0, np.pi) + np.linspace(0, 1, rows)
        o[:, 3], o[:, 6] = np.cos(half), np.sin(half)
        o[:, 7:15] = np.radians([0, 50, 0, -50, 0, -50, 0, 50]) + rng.normal(0, 0.1, (rows, 8))
        o[:, 15:17] = np.gradient(o[:, :2], axis=0) / 0.1
        o[:, 17:] = rng.normal(0, 0.3, (rows, 12))
        parts.append(o)
    n = count * rows
    ends = np.arange(1, n + 1) % rows == 0
    return dict(observations=np.concatenate(parts), actions=rng.uniform(-1, 1, (n, 8)), rewards=np.zeros(n),
                terminals=np.zeros(n, bool), timeouts=ends, goal=np.tile(points[-1], (n, 1)))


def d4rl(bench, name, data):
    with h5py.File(bench.folder / name, "w") as file:
        for key, values in data.items():
            key = "infos/goal" if key == "goal" else key
            file[key] = values.astype("f4") if values.dtype == float else values


def minari(bench, name, data):
    folder = bench.folder / name / "data"
    folder.mkdir(parents=True)
    ends = np.flatnonzero(data["timeouts"]) + 1
    with h5py.File(folder / "main_data.hdf5", "w") as file:
        for k, (a, b) in enumerate(zip([0, *ends[:-1]], ends)):
            o = data["observations"][a:b]
            for key, values in {
                "observations/observation": o[:, 2:], "observations/achieved_goal": o[:, :2],
                "observations/desired_goal": data["goal"][a:b], "actions": data["actions"][a:b - 1],
                "rewards": np.zeros(b - a - 1), "terminations": np.zeros(b - a - 1, bool),
                "truncations": np.arange(1, b - a) == b - a - 1,
            }.items():
                file[f"episode_{k}/{key}"] = values


def config(bench, layout, path, name="c.toml"):
    bench.write(name, CONFIG % (layout, path))
    return name


def refused(bench, layout, data, *words):
    """Both check and launch refuse, with one line, and no run is left."""
    d4rl(bench, "x.hdf5", data)
    name = config(bench, layout, "x.hdf5")
    for command in ("check", "launch"):
        outcome = bench.formica(command, name).fails(2, "x.hdf5: ", *words)
        assert len(outcome.err.splitlines()) == 1, outcome
    assert not (bench.folder / "runs").exists(), "a run was started"


def edited(data, change):
    data = {key: values.copy() for key, values in data.items()}
    change(data["observations"])
    return data


@case("-")
def sound_data_are_taken_without_a_word(bench):
    d4rl(bench, "x.hdf5", walks(MEDIUM))
    outcome = bench.formica("check", config(bench, "medium", "x.hdf5")).succeeds("no fault found")
    outcome.never_says("note")


@case("Minari#304, D4RL#78")
def data_of_another_maze_are_refused_with_the_share_and_the_maze_that_fits(bench):
    refused(bench, "medium", walks(UMAZE), "% of the rows lie inside walls of 'medium'", "they fit 'umaze' (0.0%)")


@case("Minari#304, D4RL#78")
def data_of_a_larger_maze_are_refused(bench):
    refused(bench, "umaze", walks(MEDIUM), "% of the rows lie inside walls of 'umaze'", "they fit 'medium'")


@case("D4RL#77")
def far_data_are_refused_with_the_row(bench):
    refused(bench, "medium", edited(walks(MEDIUM), lambda o: o[:, 0].__iadd__(1e9)), "row 0 lies at (1.00e9, ")


@case("D4RL#77")
def one_far_row_is_refused(bench):
    def change(o):
        o[321, 1] = -4e7
    refused(bench, "medium", edited(walks(MEDIUM), change), "row 321 lies at (", "1 of 1200 rows")


@case("-")
def units_are_told_by_the_maze_and_the_velocities(bench):
    def times(factor):
        def change(o):
            o[:, :2] *= factor
        return change
    refused(bench, "medium", edited(walks(MEDIUM), times(1000)), "they fit as millimetres")
    refused(bench, "medium", edited(walks(MEDIUM), times(0.25)), "cells of 4 m")


@case("Gymnasium#1003, D4RL#179")
def columns_in_another_order_are_refused(bench):
    def last(o):
        o[:, 3:7] = o[:, [4, 5, 6, 3]]
    refused(bench, "medium", edited(walks(MEDIUM), last), "stands as x, y, z, w in columns 3 to 6")
    def velocities_first(o):
        o[:] = np.hstack([o[:, 15:], o[:, :15]])
    refused(bench, "medium", edited(walks(MEDIUM), velocities_first), "columns 17 to 20 hold one")
    def degrees(o):
        o[:, 7:15] = np.degrees(o[:, 7:15])
    refused(bench, "medium", edited(walks(MEDIUM), degrees), "joint angles")


@case("-")
def actions_that_are_torques_or_missing_are_refused(bench):
    data = walks(MEDIUM)
    refused(bench, "medium", {**data, "actions": data["actions"] * 30}, "actions are not within -1 to 1")
    refused(bench, "medium", {**data, "actions": data["actions"] * 0}, "every row has the same action")


@case("D4RL#85")
def an_end_in_every_row_is_refused_at_once(bench):
    data = walks(MEDIUM)
    data["timeouts"][:] = True
    refused(bench, "medium", data, "the longest of 1200 has 1 row", "timeouts")


@case("-")
def short_still_and_shuffled_data_are_refused(bench):
    data = walks(MEDIUM)
    ends = np.arange(1, 1201) % 8 == 0
    refused(bench, "medium", {**data, "timeouts": ends}, "no episode has more rows than graph.lag = 15")
    def still(o):
        o[:] = o[0]
    refused(bench, "medium", edited(data, still), "under way in 0 of 1200 rows")
    order = np.random.default_rng(0).permutation(1200)
    refused(bench, "medium", {**data, "observations": data["observations"][order]}, "are the rows shuffled?")


@case("-")
def odd_data_may_be_taken_on_ones_own_responsibility(bench):
    d4rl(bench, "x.hdf5", walks(UMAZE))
    name = config(bench, "large", "x.hdf5")
    bench.formica("check", name).fails(2, "dataset.fit")
    bench.formica("check", name, "--set", "dataset.fit=warn").succeeds("note: ", "x.hdf5: ", "inside walls of 'large'")


@case("D4RL#77")
def far_data_that_are_taken_all_the_same_end_the_run_with_one_message(bench):
    data = edited(walks(MEDIUM), lambda o: o[:, 0].__iadd__(1e9))
    d4rl(bench, "x.hdf5", data)
    outcome = bench.formica("launch", config(bench, "medium", "x.hdf5"), "--set", "dataset.fit=warn")
    assert outcome.code in (1, 2), outcome
    outcome.never_says("starting it again", "restarts:")
    assert outcome.text.count("no ant comes to") <= 1, outcome


def centred(data, columns, rows):
    """As Gymnasium-Robotics has it: the origin at the maze's centre, y upwards, and the ant mirrored with it."""
    o = data["observations"].copy()
    goal = data["goal"].copy()
    for places in (o, goal):
        places[:, 0] -= 2 * columns - 6
        places[:, 1] = 2 * rows - 6 - places[:, 1]
    o[:, [4, 6, 16, 18, 20]] *= -1
    legs = [6, 7, 4, 5, 2, 3, 0, 1]
    sign = np.array([-1, 1] * 4)
    o[:, 7:15], o[:, 21:29] = o[:, 7:15][:, legs] * sign, o[:, 21:29][:, legs] * sign
    return {**data, "observations": o, "goal": goal}


@case("Gymnasium-Robotics maze_v4.py, Minari#296")
def gymnasium_robotics_frame_is_recognised(bench):
    for layout, way, shape in (("umaze", UMAZE, (5, 5)), ("medium", MEDIUM, (8, 8))):
        minari(bench, f"{layout}-v1", centred(walks(way), *shape))
        outcome = bench.formica("check", config(bench, layout, f"{layout}-v1"))
        outcome.succeeds("recognised Gymnasium-Robotics' frame", "converted", "no fault found")
    outcome = bench.formica("launch", "c.toml").succeeds("recognised Gymnasium-Robotics' frame")
    log = (bench.folder / "runs/c/logs/graph-builder-0.log").read_text()
    assert "recognised Gymnasium-Robotics' frame" in log, log


@case("D4RL's maze2d")
def rows_of_another_body_are_named(bench):
    data = walks(MEDIUM)
    points = {**data, "observations": data["observations"][:, [0, 1, 15, 16]], "actions": data["actions"][:, :2]}
    d4rl(bench, "x.hdf5", points)
    for more in ((), ("--set", "dataset.fit=warn")):
        outcome = bench.formica("check", config(bench, "medium", "x.hdf5"), *more)
        outcome.fails(2, "observations of 4 values and actions of 2", "widths are those of 'point'", "use data recorded with 'ant'")
    bench.formica("dataset", "convert", "x.hdf5", "m-v0", "--to", "minari").succeeds()
    bench.formica("dataset", "info", "m-v0").succeeds("observations of 4 values and actions of 2")


@case("Gymnasium-Robotics")
def steps_of_half_the_time_are_told(bench):
    def change(o):
        o[:, 15:17] *= 2
    d4rl(bench, "x.hdf5", edited(walks(MEDIUM), change))
    bench.formica("check", config(bench, "medium", "x.hdf5")).succeeds("rows lie 0.05 s apart")


@case("D4RL#245")
def next_observations_and_jumps_end_episodes(bench):
    data = walks(MEDIUM, count=4)
    # What qlearning_dataset leaves: no timeouts, each episode's last row gone.
    keep = np.flatnonzero(~data["timeouts"])
    late = {key: values[keep] for key, values in data.items() if key != "timeouts"}
    late["next_observations"] = data["observations"][keep + 1]
    d4rl(bench, "q.hdf5", late)
    bench.formica("dataset", "info", "q.hdf5").succeeds("episodes      4")
    # Without them, a jump of 3 m tells: the second way begins that far from where the first ends.
    first, second = data["observations"][:150][::-1], data["observations"][11:150]
    one = {key: values[:150 + 139] for key, values in data.items()}
    one["observations"] = np.concatenate([first, second])
    one["observations"][:150, 15:17] *= -1
    one["timeouts"] = np.zeros(289, bool)
    d4rl(bench, "j.hdf5", one)
    bench.formica("check", config(bench, "medium", "j.hdf5")).succeeds("episodes are cut there")


@case("-")
def a_collected_set_says_how_it_was_made(bench):
    bench.small_run()
    with h5py.File(bench.folder / "data.hdf5") as file:
        made = dict(file.attrs)
    assert made["maze"] == "umaze" and made["style"] == "diverse" and made["transitions"] == "12000", made
    assert len(made["walker"]) == 16 and made["seed"] == "0" and made["formica_version"], made
    bench.formica("check", "small.toml").succeeds("no fault found").never_says("note")
    bench.formica("check", "small.toml", "--set", "maze.layout=large").fails(
        2, "data.hdf5: was collected in maze.layout = \"umaze\", the config has \"large\"")
    bench.formica("check", "small.toml", "--set", "collect.noise=0.5").succeeds(
        "was collected with collect.noise = 0.2, the config has 0.5")
    bench.formica("check", "small.toml", "--set", "run.seed=3").succeeds().never_says("note")


@case("-")
def a_million_rows_are_checked_within_seconds(bench):
    data = walks(MEDIUM, count=1000, rows=1000)
    with h5py.File(bench.folder / "x.hdf5", "w") as file:
        for key in ("observations", "actions", "rewards", "terminals", "timeouts"):
            values = data[key].astype("f4") if data[key].dtype == float else data[key]
            file.create_dataset(key, data=values, chunks=(8192, *values.shape[1:]), compression="gzip", compression_opts=1)
    name = config(bench, "medium", "x.hdf5")
    start = time.monotonic()
    bench.formica("check", name).succeeds("no fault found")
    seconds = time.monotonic() - start
    # Two where the machine is idle; here other cases run beside it.
    assert seconds < 6, f"{seconds:.1f} s"
