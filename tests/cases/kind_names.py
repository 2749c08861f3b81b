"""Names and paths: any file's name, reserved names, `~` and variables, links, runs from any folder."""
import os

from harness import SMALL, case

QUICK = '[dataset]\npath = "data.hdf5"\n[collect]\n'


@case("ray#6953")
def the_name_of_any_file_gives_a_sound_name(bench):
    for file, name in [
        ("my config (1).toml", "my-config-1"), ("größe ☕.toml", "grosse-coffee"), ("a\nb.toml", "a-b"),
        ("x" * 200 + ".toml", "x" * 64), ("$(touch pwned).toml", "touch-pwned"),
    ]:
        bench.write(file, QUICK)
        bench.formica("check", file).succeeds(f"the run's name is {name}\n")
    # No bytes that are text.
    path = os.fsencode(bench.folder) + b"/\xff\xfe.toml"
    with open(path, "w") as file:
        file.write(QUICK)
    bench.formica("check", os.fsdecode(path)).fails(2, "so set run.name")


@case("wandb#1293")
def reserved_names_are_refused(bench):
    bench.write("c.toml", QUICK)
    for file in ["latest.toml", "Latest.toml", "....toml"]:
        bench.write(file, QUICK)
        bench.formica("check", file).fails(2, "run.name: ")
    for name in ["latest", ".", "..", "-x", ".x", "a/b", "../x", "", "x.mcap"]:
        bench.formica("check", "c.toml", "--set", f"run.name={name}").fails(2, "--set run.name: ")
    assert not (bench.folder / "runs").exists()


@case("parsedmarc#485")
def home_and_variables_are_filled_in_or_faults(bench):
    home = bench.folder / "home"
    for path in ["~/d.hdf5", "$HOME/d.hdf5", "${HOME}/d.hdf5"]:
        bench.write("c.toml", f'[dataset]\npath = "{path}"\n')
        bench.formica("check", "c.toml", env={"HOME": str(home)}).fails(2, f"no file '{home}/d.hdf5'")
    for path, told in [("~nobody/d", "~nobody"), ("$NO_SUCH/d", "NO_SUCH is not set"), ("a$", "$$")]:
        bench.write("c.toml", f'[dataset]\npath = "{path}"\n[collect]\n')
        bench.formica("check", "c.toml").fails(2, "c.toml:2: dataset.path: ", told)
    bench.write("c.toml", QUICK)
    bench.formica("check", "c.toml", "--set", "dataset.path=~/d", env={"HOME": None}).fails(2, "HOME")
    small = SMALL.replace('"data.hdf5"', '"~/deep/$$1.hdf5"').replace("transitions = 12000", "transitions = 2000")
    bench.write("small.toml", small)
    bench.formica("collect", "small.toml", env={"HOME": str(home)}).succeeds()
    assert (home / "deep" / "$1.hdf5").is_file()
    assert not (bench.folder / "~").exists()


@case("-")
def all_commands_take_a_run_by_name_folder_and_link(bench):
    run = bench.small_run()
    (bench.folder / "link").symlink_to("runs/small")
    (bench.folder / "elsewhere").mkdir()
    ways = [
        (".", "small"), (".", "small/"), (".", "latest"), (".", "runs/latest/"), (".", "link"), (".", str(run)),
        ("elsewhere", "../link"), ("elsewhere", "../runs/latest"), ("runs", "small"), ("runs/small", "."),
    ]
    for i, (cwd, given) in enumerate(ways):
        folder = bench.folder / cwd
        bench.formica("curves", given, "--out", bench.folder / f"{i}.svg", cwd=folder).succeeds()
        bench.formica("report", given, "--out", bench.folder / f"{i}.html", cwd=folder).succeeds()
        bench.formica("launch", "--resume", given, cwd=folder).succeeds("is finished")
        bench.formica("actor", "--attach", given, cwd=folder).fails(1, "not alive")
    assert os.readlink(bench.folder / "runs" / "latest") == "small"


@case("demes PR 411")
def latest_is_healed_and_never_points_to_itself(bench):
    bench.small_run()
    latest = bench.folder / "runs" / "latest"
    for episodes, target in [(9, "latest"), (10, "gone")]:
        latest.unlink()
        latest.symlink_to(target)
        bench.formica("curves", "latest").fails(1, "is a link to " + target, "small")
        bench.formica("launch", "--resume", "small", "--set", f"evaluation.episodes={episodes}").succeeds()
        assert os.readlink(latest) == "small"


@case("-")
def a_name_that_was_mistyped_is_told(bench):
    bench.small_run()
    for command in [["launch", "--resume"], ["curves"], ["report"]]:
        bench.formica(*command, "smal").fails(1, "there is no run smal", "did you mean small?")
        bench.formica(*command, "other").fails(1, "there is no run other", "there are small")
    bench.formica("launch", "--resume", "small.toml").fails(1, "is a run file")
    bench.formica("actor", "--attach", "smal").fails(1, "there is no run 'smal'", "did you mean 'small'?")
