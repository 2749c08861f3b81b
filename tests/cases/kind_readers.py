"""Files of data sets with known quirks: what h5py and numpy read is read, and what is not is named with its remedy."""
import io
import zipfile

import datasets
import h5py
import hdf5plugin
import numpy as np
from harness import case


@case("hdf5-pure#433")
def soft_links_of_all_kinds_are_followed(bench):
    data = datasets.rows()
    with h5py.File(bench.folder / "x.hdf5", "w") as out:
        for key in datasets.KEYS:
            out["train/" + key] = data[key]
        out["observations"] = h5py.SoftLink("/train/observations")
        out["actions"] = h5py.SoftLink("train/actions")
        out["rewards"] = out["train/rewards"]
        out["all"] = h5py.SoftLink("train")
        out["terminals"] = h5py.SoftLink("all/terminals")
        out["last"] = h5py.SoftLink("/all/timeouts")
        out["timeouts"] = h5py.SoftLink("last")
    datasets.same(datasets.read(bench, "x.hdf5"), data)


@case("hdf5-pure#433")
def an_alias_beside_the_keys_changes_nothing(bench):
    for name, options in {"old": {}, "new": dict(libver="latest", track_order=True)}.items():
        data = datasets.d4rl(bench.folder / f"{name}.hdf5", file=options)
        with h5py.File(bench.folder / f"{name}.hdf5", "a") as out:
            out["obs"] = h5py.SoftLink("/observations")
            out["gone"] = h5py.SoftLink("/nothing/here")
            out["circle"] = h5py.SoftLink("/circle")
            out["far"] = h5py.ExternalLink("no.hdf5", "/x")
        datasets.same(datasets.read(bench, f"{name}.hdf5"), data)


@case("hdf5-pure#433")
def a_link_that_leads_nowhere_is_never_a_missing_key(bench):
    for key in ("timeouts", "terminals"):
        datasets.d4rl(bench.folder / "x.hdf5")
        with h5py.File(bench.folder / "x.hdf5", "a") as out:
            del out[key]
            out[key] = h5py.SoftLink("/gone")
        bench.formica("dataset", "info", "x.hdf5").fails(2, f"x.hdf5: '{key}'", "is a link to '/gone'")


@case("silx#4499")
def the_newest_layout_of_hdf5_is_read(bench):
    data = datasets.rows()
    for name, array in {
        "chunked": dict(chunks=True, compression="gzip", shuffle=True),
        "single": dict(chunks=True, compression="gzip"),
        "checked": dict(chunks=True, fletcher32=True),
    }.items():
        datasets.d4rl(bench.folder / f"{name}.hdf5", file=dict(libver="latest"), array=array)
        datasets.same(datasets.read(bench, f"{name}.hdf5"), data)
    with h5py.File(bench.folder / "resizable.hdf5", "w", libver="latest") as out:
        for key in datasets.KEYS:
            values = data[key]
            out.create_dataset(key, data=values, chunks=(16, *values.shape[1:]), maxshape=(None,) * values.ndim, compression="lzf")
    datasets.same(datasets.read(bench, "resizable.hdf5"), data)


@case("hdf5-pure#430")
def chunks_are_found_whatever_the_greatest_shape(bench):
    data = datasets.rows()
    count = len(data["rewards"])
    for number, (chunks, most) in enumerate((
        ((16, 10), (2 * count, 58)), ((64, 1), (count, 58)), ((16, 29), (None, 58)),
        ((16, 10), (None, None)), ((count, 29), (count, None)),
    )):
        for version in ("v108", "v110", "latest"):
            for options in ({}, dict(compression="gzip", shuffle=True, fletcher32=True)):
                name = f"{number}-{version}-{len(options)}.hdf5"
                with h5py.File(bench.folder / name, "w", libver=(version, version)) as out:
                    for key in datasets.KEYS[1:]:
                        out[key] = data[key]
                    out.create_dataset("observations", data=data["observations"], chunks=chunks, maxshape=most, **options)
                datasets.same(datasets.read(bench, name), data)


@case("hdfview#335")
def numbers_of_all_types_are_read(bench):
    for number, types in enumerate((
        dict(observations="<f2", actions=">f2", terminals=">i4", timeouts="<i8"),
        dict(observations=">f8", actions=">f4", rewards=">i2", terminals="u1", timeouts="<f8"),
        dict(rewards=">f2", terminals=">u8", timeouts="i1"),
    )):
        data = datasets.d4rl(bench.folder / f"{number}.hdf5", types=types)
        datasets.same(datasets.read(bench, f"{number}.hdf5"), data, 0.005 if number == 0 else 0.0)


@case("hdfview#335")
def arrays_that_hold_no_numbers_are_named(bench):
    for name, values in {"text": ["a"] * 155, "complex": np.zeros(155, "c8"), "record": np.zeros(155, [("a", "f4")])}.items():
        datasets.d4rl(bench.folder / f"{name}.hdf5")
        with h5py.File(bench.folder / f"{name}.hdf5", "a") as out:
            del out["timeouts"]
            out["timeouts"] = values
        bench.formica("dataset", "info", f"{name}.hdf5").fails(2, f"{name}.hdf5: 'timeouts'", "not numbers")


@case("Minari PR 31")
def links_into_other_files_are_followed_or_named(bench):
    datasets.minari(bench.folder / "a")
    main = bench.folder / "combined" / "data" / "main_data.hdf5"
    main.parent.mkdir(parents=True)
    with h5py.File(main, "w", track_order=True) as out:
        for number in range(4):
            out[f"episode_{number}"] = h5py.ExternalLink("../../a/data/main_data.hdf5", f"/episode_{number}")
    found, whole = datasets.read(bench, "combined"), datasets.read(bench, "a")
    assert (found["observations"] == whole["observations"]).all()
    (bench.folder / "a").rename(bench.folder / "b")
    bench.formica("dataset", "info", "combined").fails(2, "episode_0", "../../a/data/main_data.hdf5", "No such file")


@case("-")
def virtual_data_sets_are_refused_with_the_remedy(bench):
    data = datasets.d4rl(bench.folder / "a.hdf5")
    with h5py.File(bench.folder / "x.hdf5", "w", libver="latest") as out:
        for key in datasets.KEYS:
            layout = h5py.VirtualLayout(data[key].shape, data[key].dtype)
            layout[:] = h5py.VirtualSource("a.hdf5", key, data[key].shape)
            out.create_virtual_dataset(key, layout)
    bench.formica("dataset", "info", "x.hdf5").fails(2, "x.hdf5: 'observations'", "virtual data set", "h5py")


@case("kerchunk#351")
def compressions_are_read_or_named_with_the_remedy(bench):
    for name, array in {"lzf": dict(compression="lzf"), "shuffled": dict(compression="lzf", shuffle=True, fletcher32=True)}.items():
        data = datasets.d4rl(bench.folder / f"{name}.hdf5", array=array)
        datasets.same(datasets.read(bench, f"{name}.hdf5"), data)
    for name, array in {"Blosc": hdf5plugin.Blosc(), "Zstandard": hdf5plugin.Zstd(), "Bitshuffle": hdf5plugin.Bitshuffle()}.items():
        datasets.d4rl(bench.folder / f"{name}.hdf5", array=dict(array))
        bench.formica("dataset", "info", f"{name}.hdf5").fails(2, f"compressed with {name}", "h5repack")


@case("Minari#199")
def faulty_episodes_are_dropped_when_asked(bench):
    def short(number, arrays):
        if number == 1:
            for key in [key for key in arrays if key.startswith("observations/")]:
                arrays[key] = arrays[key][:-1]

    data = datasets.minari(bench.folder / "m", short)
    bench.formica("dataset", "info", "m").fails(2, "episode_1", "--on-fault drop-episode")
    bench.formica("dataset", "info", "m", "--on-fault", "drop-episode").succeeds("1 of 4 episodes left out", "episode_1")
    found = datasets.read(bench, "m", "--on-fault", "drop-episode")
    kept = np.r_[0:40, 65:155]
    assert (found["observations"] == data["observations"][kept]).all()
    nan = datasets.rows()
    nan["observations"][50, 7] = np.nan
    nan["actions"][70, 2] = np.inf
    datasets.d4rl(bench.folder / "x.hdf5", nan)
    np.savez(bench.folder / "x.npz", observations=nan["observations"], actions=nan["actions"], terminals=nan["timeouts"])
    for name in ("x.hdf5", "x.npz"):
        bench.formica("dataset", "info", name).fails(2, "row 50", "drop-episode")
        found = datasets.read(bench, name, "--on-fault", "drop-episode")
        assert (found["observations"] == data["observations"][np.r_[0:40, 125:155]]).all()
    nan["rewards"][[0, 41, 66]] = np.nan
    datasets.d4rl(bench.folder / "most.hdf5", nan)
    bench.formica("dataset", "info", "most.hdf5", "--on-fault", "drop-episode").fails(2, "3 of 4 episodes are faulty")


@case("-")
def a_missing_key_is_told_with_what_is_there(bench):
    data = datasets.rows()
    with h5py.File(bench.folder / "x.hdf5", "w") as out:
        out["observations"], out["acts"] = data["observations"], data["actions"]
    bench.formica("dataset", "info", "x.hdf5").fails(
        2, "'actions': is missing among acts, observations", "D4RL's layout wants", "Minari's", "OGBench's"
    ).never_says("the layout has it")


def entries(data):
    for key, values in dict(observations=data["observations"], actions=data["actions"], terminals=data["timeouts"]).items():
        out = io.BytesIO()
        np.lib.format.write_array(out, values, allow_pickle=False)
        yield f"{key}.npy", out.getvalue()


@case("-")
def what_numpy_reads_of_an_archive_is_read(bench):
    data = datasets.rows()
    arrays = dict(observations=data["observations"], actions=data["actions"], terminals=data["timeouts"])
    np.savez(bench.folder / "half.npz", **{**arrays, "observations": data["observations"].astype("<f2")})
    np.savez_compressed(bench.folder / "big.npz", **{**arrays, "actions": data["actions"].astype(">f8"), "terminals": data["timeouts"].astype(">i4")})
    np.savez(bench.folder / "fortran.npz", **{**arrays, "observations": np.asfortranarray(data["observations"])})
    for name, folder in {"folder": "antmaze/", "bare": ""}.items():
        with zipfile.ZipFile(bench.folder / f"{name}.npz", "w", zipfile.ZIP_DEFLATED) as out:
            for key, values in entries(data):
                with out.open(folder + key, "w", force_zip64=True) as file:
                    file.write(values)
    for name in ("half", "big", "fortran", "folder", "bare"):
        datasets.same(datasets.read(bench, f"{name}.npz"), data, 0.005 if name == "half" else 0.0)
    for name, method in {"Bzip2": zipfile.ZIP_BZIP2, "Lzma": zipfile.ZIP_LZMA}.items():
        with zipfile.ZipFile(bench.folder / f"{name}.npz", "w", method) as out:
            for key, values in entries(data):
                out.writestr(key, values)
        bench.formica("dataset", "info", f"{name}.npz").fails(2, f"compressed with {name}", "savez_compressed")
