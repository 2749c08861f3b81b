#!/usr/bin/env python3
"""Opens one data set in three formats with the formats' own packages and compares the arrays; then
has formica read files that Minari and numpy wrote.

Usage: check_formats.py FORMICA D4RL_FILE MINARI_FOLDER OGBENCH_FILE
       (the three made by `formica dataset convert` from one data set;
       pip install h5py numpy "minari[hdf5]" ogbench)
Exit code: 0 all fine, 1 something is wrong, 2 usage.
"""

import os
import pathlib
import subprocess
import sys
import tempfile

import h5py
import numpy as np


def equal(name, got, expected):
    assert got.shape == expected.shape, f"{name}: {got.shape}, expected {expected.shape}"
    assert np.array_equal(got, expected), f"{name} differs"


def check_minari(folder, d4rl, ends):
    os.environ["MINARI_DATASETS_PATH"] = str(folder.resolve().parent)
    import minari

    data = minari.load_dataset(folder.name)
    assert data.total_episodes == len(ends), f"{data.total_episodes} episodes"
    assert data.total_steps == sum(last - first for first, last in ends), "total_steps"
    assert data.spec.dataset_id.startswith(folder.name), data.spec.dataset_id
    for episode, (first, last) in zip(data.iterate_episodes(), ends):
        rows, acted = slice(first, last + 1), slice(first, last)
        o = episode.observations
        for key, values in o.items():
            space = data.observation_space[key]
            assert values.dtype == space.dtype and values.shape[1:] == space.shape, key
        equal("achieved_goal ++ observation", np.hstack([o["achieved_goal"], o["observation"]]),
              d4rl["observations"][rows])
        if "infos/goal" in d4rl:
            equal("desired_goal", o["desired_goal"], d4rl["infos/goal"][rows])
        equal("actions", episode.actions, d4rl["actions"][acted])
        equal("rewards", episode.rewards, d4rl["rewards"][acted])
        equal("terminations", episode.terminations, d4rl["terminals"][acted])
        ended = episode.terminations | episode.truncations
        assert last == first or ended[-1], "an episode does not end"
    print(f"minari: {data.total_episodes} episodes, {data.total_steps} steps, as in D4RL's file")


def check_ogbench(path, d4rl):
    from ogbench.utils import load_dataset

    inner = ~d4rl["timeouts"]
    data = load_dataset(str(path), add_info=True)
    equal("observations", data["observations"], d4rl["observations"][inner])
    equal("actions", data["actions"], d4rl["actions"][inner])
    after = np.flatnonzero(inner) + 1
    equal("next_observations", data["next_observations"], d4rl["observations"][after])
    equal("terminals", data["terminals"] > 0, d4rl["timeouts"][after])
    equal("qpos ++ qvel", np.hstack([data["qpos"], data["qvel"]]), data["observations"])
    compact = load_dataset(str(path), compact_dataset=True)
    equal("valids", compact["valids"] > 0, inner)
    print(f"ogbench: {data['observations'].shape[0]} transitions, as in D4RL's file")


def told(formica, path, *expected):
    result = subprocess.run([formica, "dataset", "info", path], capture_output=True, text=True)
    assert result.returncode == 0, f"{path}: {result.stderr}"
    lines = [" ".join(line.split()) for line in result.stdout.splitlines()]
    for line in expected:
        assert line in lines, f"'{line}' is not told of {path}:\n{result.stdout}"


def check_reading(formica, folder, d4rl, ends):
    """Files of the packages themselves, Minari's with doubles as its hosted data have."""
    import gymnasium as gym
    import minari
    from minari.data_collector import EpisodeBuffer

    os.environ["MINARI_DATASETS_PATH"] = folder
    box = lambda width: gym.spaces.Box(-np.inf, np.inf, (width,), np.float64)
    buffers = []
    for number, (first, last) in enumerate(ends[:12]):
        o = d4rl["observations"][first:last + 1].astype(np.float64)
        steps = last - first
        buffers.append(EpisodeBuffer(
            id=number,
            observations={"observation": o[:, 2:], "achieved_goal": o[:, :2],
                          "desired_goal": np.zeros((steps + 1, 2))},
            actions=d4rl["actions"][first:last],
            rewards=d4rl["rewards"][first:last].astype(np.float64),
            terminations=np.zeros(steps, bool),
            truncations=np.arange(1, steps + 1) == steps,
            infos={"success": np.zeros(steps + 1, bool)},
        ))
    minari.create_dataset_from_buffers(
        "made/antmaze-v0", buffers,
        observation_space=gym.spaces.Dict(
            observation=box(27), achieved_goal=box(2), desired_goal=box(2)),
        action_space=gym.spaces.Box(-1, 1, (8,), np.float32),
    )
    rows = ends[min(12, len(ends)) - 1][1] + 1
    told(formica, os.path.join(folder, "made", "antmaze-v0"),
         "format Minari", f"rows {rows}", f"episodes {len(buffers)}")
    for save in (np.savez, np.savez_compressed):
        path = os.path.join(folder, save.__name__ + ".npz")
        save(path, observations=d4rl["observations"], actions=d4rl["actions"],
             terminals=d4rl["timeouts"])
        told(formica, path, "format OGBench npz", f"rows {len(d4rl['timeouts'])}",
             f"episodes {len(ends)}")
    path = os.path.join(folder, "h5py.hdf5")
    with h5py.File(path, "w") as file:
        for key, values in d4rl.items():
            file.create_dataset(key, data=values, compression="gzip")
    told(formica, path, "format D4RL HDF5", f"rows {len(d4rl['timeouts'])}",
         f"episodes {len(ends)}")
    print("formica: reads what minari, numpy and h5py wrote")


def main(arguments):
    if len(arguments) != 4:
        print(__doc__.strip(), file=sys.stderr)
        return 2
    formica, d4rl_path, minari_path, ogbench_path = arguments
    try:
        with h5py.File(d4rl_path, "r") as file:
            keys = ["observations", "actions", "rewards", "terminals", "timeouts", "infos/goal"]
            d4rl = {key: file[key][()] for key in keys if key in file}
        lasts = np.flatnonzero(d4rl["timeouts"])
        ends = list(zip([0, *(lasts[:-1] + 1)], lasts))
        print(f"h5py: {len(d4rl['timeouts'])} rows in {len(ends)} episodes")
        check_minari(pathlib.Path(minari_path), d4rl, ends)
        check_ogbench(ogbench_path, d4rl)
        with tempfile.TemporaryDirectory() as folder:
            check_reading(formica, folder, d4rl, ends)
    except (AssertionError, OSError, KeyError, ValueError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
