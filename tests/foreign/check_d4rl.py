#!/usr/bin/env python3
"""Opens data sets with h5py and checks D4RL's layout, as D4RL's own readers expect it.

Usage: check_d4rl.py FILE...      (pip install h5py numpy)
Exit code: 0 all fine, 1 a file is wrong, 2 usage.
"""

import sys

import h5py
import numpy as np

# Key: (width or None for flat, dtype).
LAYOUT = {
    "observations": (29, "f4"),
    "actions": (8, "f4"),
    "rewards": (None, "f4"),
    "terminals": (None, "b1"),
    "timeouts": (None, "b1"),
    "infos/goal": (2, "f4"),
    "infos/qpos": (15, "f4"),
    "infos/qvel": (14, "f4"),
}
# A reset moves the torso further than any control step (m).
JUMP = 5.0


def check(path):
    values = {}
    with h5py.File(path, "r") as file:
        rows = file["observations"].shape[0]
        assert rows > 0, "no rows"
        for key, (width, kind) in LAYOUT.items():
            assert key in file, f"{key} is missing"
            array = file[key]
            shape = (rows,) if width is None else (rows, width)
            assert array.shape == shape, f"{key} has shape {array.shape}, expected {shape}"
            assert array.dtype == np.dtype(kind), f"{key} is {array.dtype}, expected {kind}"
            assert array.compression == "gzip", f"{key} is not compressed with gzip"
            values[key] = array[()]
            if kind == "f4":
                assert np.isfinite(values[key]).all(), f"{key} holds a value that is not finite"
    assert np.abs(values["actions"]).max() <= 1, "an action is outside [-1, 1]"
    norms = np.linalg.norm(values["observations"][:, 3:7], axis=1)
    assert np.abs(norms - 1).max() < 1e-2, "a quaternion is not of unit length"
    assert set(np.unique(values["rewards"])) <= {0, 1}, "a reward is neither 0 nor 1"
    ends = values["timeouts"]
    assert ends[-1], "the last row ends no episode"
    places = values["observations"][:, :2]
    inside = np.linalg.norm(np.diff(places, axis=0), axis=1)[~ends[:-1]]
    assert inside.size == 0 or inside.max() <= JUMP, "the torso jumps inside an episode"
    # The script of D4RL writes qpos and qvel after the step: they are the next row's observation.
    after = np.concatenate([values["infos/qpos"], values["infos/qvel"]], axis=1)
    gap = np.abs(after[:-1] - values["observations"][1:])[~ends[:-1]]
    assert gap.size == 0 or gap.max() < 1e-4, "infos/qpos and qvel are not those of the next row"
    lengths = np.diff(np.flatnonzero(np.r_[True, ends]))
    print(f"{path}: {rows} rows, {lengths.size} episodes of {lengths.min()} to {lengths.max()}")


def main(paths):
    if not paths:
        print(__doc__.strip(), file=sys.stderr)
        return 2
    wrong = 0
    for path in paths:
        try:
            check(path)
        except (AssertionError, OSError, KeyError) as error:
            print(f"{path}: {error}", file=sys.stderr)
            wrong = 1
    return wrong


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
