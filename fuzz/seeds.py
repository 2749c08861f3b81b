"""Writes the seeds that h5py and numpy make, into fuzz/corpus: `python3 fuzz/seeds.py [NAME...]` (PyPI's h5py, 3.16 or newer).

Tests of crates/dataset read them too: all hold the same four rows, exact in half precision.
"""
import io
import pathlib
import sys
import zipfile

import h5py
import numpy as np

CORPUS = pathlib.Path(__file__).parent / "corpus"
KEYS = ("observations", "actions", "rewards", "terminals", "timeouts")
SEEDS = {}


def rows():
    """Four rows: an episode of three and one of one."""
    data = dict(
        observations=(np.arange(4 * 29).reshape(4, 29) % 32 / 16).astype("f4"),
        actions=(np.arange(4 * 8).reshape(4, 8) % 16 / 16 - 0.5).astype("f4"),
        rewards=np.array([0, 1, 0, 1], "f4"),
        terminals=np.array([0, 1, 0, 1], bool),
        timeouts=np.array([0, 0, 1, 1], bool),
    )
    return data


def seed(folder):
    def register(function):
        SEEDS[f"{folder}/{function.__name__.replace('_', '-')}"] = function
        return function

    return register


def links(file):
    data = rows()
    for key in KEYS:
        file["deep/train/" + key] = data[key]
    file["observations"] = h5py.SoftLink("/deep/train/observations")
    file["actions"] = h5py.SoftLink("deep/train/actions")
    file["rewards"] = file["deep/train/rewards"]
    # A chain of links, and a link to a folder on the way.
    file["first"] = h5py.SoftLink("second/terminals")
    file["second"] = h5py.SoftLink("/deep/train")
    file["terminals"] = h5py.SoftLink("first")
    file["timeouts"] = h5py.SoftLink("/second/timeouts")
    # Links that lead nowhere, and in a circle.
    file["nowhere"] = h5py.SoftLink("/gone")
    file["round"] = h5py.SoftLink("/about")
    file["about"] = h5py.SoftLink("/round")
    file["elsewhere"] = h5py.ExternalLink("other.hdf5", "/x")


@seed("d4rl")
def h5py_links(path):
    with h5py.File(path, "w") as file:
        links(file)


@seed("d4rl")
def h5py_links_dense(path):
    """More links than an object's header holds."""
    with h5py.File(path, "w", libver="latest") as file:
        links(file)


@seed("d4rl")
def h5py_links_compact(path):
    with h5py.File(path, "w", track_order=True) as file:
        data = rows()
        for key in KEYS:
            if key != "observations":
                file[key] = data[key]
        file["alias"] = data["observations"]
        file["observations"] = h5py.SoftLink("alias")


@seed("d4rl")
def h5py_dangling(path):
    data = rows()
    with h5py.File(path, "w") as file:
        for key in KEYS[:-1]:
            file[key] = data[key]
        file["timeouts"] = h5py.SoftLink("/gone")


@seed("d4rl")
def h5py_layout_5(path):
    """HDF5 2.0's own layout, which chunks with filters get."""
    data = rows()
    with h5py.File(path, "w", libver="latest") as file:
        for key in KEYS:
            file.create_dataset(key, data=data[key], chunks=True, compression="gzip", shuffle=True)


def wide(path, implicit):
    """Chunks counted for more columns than there are (hdf5-pure#430)."""
    data = rows()
    with h5py.File(path, "w", libver=("v110", "v110")) as file:
        for key in KEYS[1:]:
            file[key] = data[key]
        if not implicit:
            file.create_dataset("observations", data=data["observations"], chunks=(3, 10), maxshape=(8, 58), compression="gzip")
            return
        kind = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        kind.set_chunk((3, 10))
        kind.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        space = h5py.h5s.create_simple((4, 29), (8, 58))
        array = h5py.h5d.create(file.id, b"observations", h5py.h5t.IEEE_F32LE, space, kind)
        array.write(h5py.h5s.ALL, h5py.h5s.ALL, data["observations"])


@seed("d4rl")
def h5py_wide_fixed(path):
    wide(path, False)


@seed("d4rl")
def h5py_wide_implicit(path):
    wide(path, True)


@seed("d4rl")
def h5py_lzf(path):
    data = rows()
    with h5py.File(path, "w") as file:
        for key in KEYS:
            file.create_dataset(key, data=data[key], compression="lzf", shuffle=True, fletcher32=True)


@seed("d4rl")
def h5py_types(path):
    types = dict(observations="<f2", actions=">f2", rewards=">i2", terminals=">u4", timeouts="<i8")
    data = rows()
    with h5py.File(path, "w") as file:
        for key in KEYS:
            file[key] = data[key].astype(types[key])


@seed("d4rl")
def h5py_types_big(path):
    types = dict(observations=">f8", actions=">f4", rewards="i1", terminals=">i8", timeouts="<f4")
    data = rows()
    with h5py.File(path, "w") as file:
        file["kind"] = np.dtype(">f8")
        for key in KEYS:
            # A type with a name of its own is stored once, and referred to.
            file.create_dataset(key, data=data[key], dtype=file["kind"] if key == "observations" else types[key])


@seed("d4rl")
def h5py_bfloat16(path):
    data = rows()
    kind = h5py.h5t.IEEE_F16LE.copy()
    kind.set_fields(15, 7, 8, 0, 7)
    kind.set_ebias(127)
    with h5py.File(path, "w") as file:
        for key in KEYS[1:]:
            file[key] = data[key]
        space = h5py.h5s.create_simple((4, 29))
        h5py.h5d.create(file.id, b"observations", kind, space).write(h5py.h5s.ALL, h5py.h5s.ALL, data["observations"])


@seed("d4rl")
def h5py_virtual(path):
    data = rows()
    with h5py.File(path, "w", libver="latest") as file:
        for key in KEYS[1:]:
            file[key] = data[key]
        layout = h5py.VirtualLayout((4, 29), "f4")
        layout[:] = h5py.VirtualSource("other.hdf5", "observations", (4, 29))
        file.create_virtual_dataset("observations", layout)


@seed("d4rl")
def h5py_not_arrays(path):
    """A group and a text where arrays go."""
    data = rows()
    with h5py.File(path, "w") as file:
        for key in KEYS[:3]:
            file[key] = data[key]
        file["terminals"] = ["no", "yes", "no", "yes"]
        file.create_group("timeouts")


@seed("d4rl")
def h5py_plain_rows(path):
    with h5py.File(path, "w") as file:
        for key, values in rows().items():
            file[key] = values


@seed("d4rl")
def h5py_external(path):
    with h5py.File(path, "w") as file:
        for key in KEYS:
            file[key] = h5py.ExternalLink("good.hdf5", "/" + key)


@seed("minari")
def h5py_short(path):
    """Four episodes: one has too few observations (Minari#199), one is gone."""
    with h5py.File(path, "w") as file:
        for number, steps in ((0, 2), (1, 3), (3, 2)):
            episode = file.create_group(f"episode_{number}")
            rows = steps + (number != 1)
            for name, width in (("observation", 27), ("achieved_goal", 2), ("desired_goal", 2)):
                episode[f"observations/{name}"] = np.ones((rows, width), "f8") * number
            episode["actions"] = np.ones((steps, 8), "f4") / 2
            episode["rewards"] = np.zeros(steps)
            episode["terminations"] = np.zeros(steps, bool)
            episode["truncations"] = np.arange(steps) == steps - 1


@seed("ogbench")
def numpy_types(path):
    data = rows()
    arrays = dict(observations=data["observations"].astype("<f2"), actions=data["actions"].astype(">f2"), terminals=data["timeouts"].astype(">i4"))
    np.savez_compressed(path, **arrays)


def zipped(path, method, folder=""):
    data = rows()
    with zipfile.ZipFile(path, "w", method) as file:
        for name, values in dict(observations=data["observations"], actions=data["actions"], terminals=data["timeouts"]).items():
            bytes_ = io.BytesIO()
            np.lib.format.write_array(bytes_, values)
            file.writestr(f"{folder}{name}.npy", bytes_.getvalue())


@seed("ogbench")
def numpy_folder(path):
    zipped(path, zipfile.ZIP_DEFLATED, "antmaze/")


@seed("ogbench")
def numpy_bzip2(path):
    zipped(path, zipfile.ZIP_BZIP2)


for name, make in SEEDS.items():
    if len(sys.argv) < 2 or any(word in name for word in sys.argv[1:]):
        path = CORPUS / (name + (".npz" if name.startswith("ogbench/") else ""))
        make(path)
        print(path, path.stat().st_size)
