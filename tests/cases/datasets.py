"""Small data sets of the three formats, and what is read of one."""
import pathlib

import h5py
import numpy as np

KEYS = ("observations", "actions", "rewards", "terminals", "timeouts")
LENGTHS = (40, 25, 60, 30)


def rows():
    """Ants along x, a row each 0.1 m, in four episodes; as D4RL has them."""
    count = sum(LENGTHS)
    generator = np.random.default_rng(0)
    observations = generator.uniform(-0.5, 0.5, (count, 29)).astype("f4")
    starts = np.cumsum((0, *LENGTHS[:-1]))
    observations[:, 0] = np.concatenate([np.arange(length) / 10 for length in LENGTHS])
    observations[:, 1] = np.repeat(np.arange(len(LENGTHS)), LENGTHS) / 10
    ends = np.zeros(count, bool)
    ends[starts + LENGTHS - 1] = True
    return dict(
        observations=observations,
        actions=generator.uniform(-1, 1, (count, 8)).astype("f4"),
        rewards=ends.astype("f4"),
        terminals=np.zeros(count, bool),
        timeouts=ends,
    )


def d4rl(path, data=None, types=None, file=None, array=None):
    """A file in D4RL's layout; `types` by key, options for the file and for its arrays."""
    data = data or rows()
    with h5py.File(path, "w", **(file or {})) as out:
        for key in KEYS:
            out.create_dataset(key, data=data[key].astype((types or {}).get(key, data[key].dtype)), **(array or {}))
    return data


def minari(folder, edit=None):
    """A folder in Minari's layout; `edit(number, arrays)` changes an episode."""
    data = rows()
    main = pathlib.Path(folder) / "data" / "main_data.hdf5"
    main.parent.mkdir(parents=True)
    start = 0
    with h5py.File(main, "w", track_order=True) as out:
        for number, length in enumerate(LENGTHS):
            own = data["observations"][start : start + length].astype("f8")
            arrays = {
                "observations/observation": own[:, 2:],
                "observations/achieved_goal": own[:, :2],
                "observations/desired_goal": own[:, :2] * 0 + 4,
                "actions": data["actions"][start : start + length - 1],
                "rewards": np.zeros(length - 1),
                "terminations": np.zeros(length - 1, bool),
                "truncations": np.arange(length - 1) == length - 2,
            }
            if edit:
                edit(number, arrays)
            for key, values in arrays.items():
                out[f"episode_{number}/{key}"] = values
            start += length
    main.with_name("metadata.json").write_text('{"total_episodes": %d, "data_format": "hdf5"}' % len(LENGTHS))
    return data


def read(bench, path, *arguments):
    """What formica reads of a data set, by way of OGBench's format and numpy."""
    bench.formica("dataset", "convert", path, "read.npz", "--to", "ogbench", "--force", *arguments).succeeds()
    return dict(np.load(bench.folder / "read.npz"))


def same(found, data, tolerance=0.0):
    """What was read is what was written."""
    for key in ("observations", "actions"):
        assert found[key].shape == data[key].shape, f"{key}: {found[key].shape}"
        assert np.abs(found[key] - data[key]).max() <= tolerance, f"{key}: other values"
    assert (found["terminals"] == data["timeouts"]).all(), "other ends of episodes"
