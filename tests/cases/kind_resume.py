"""A run that is resumed: what may have changed since, what may not, and when nothing is left."""
import hashlib
import shutil

from harness import SMALL, case


def state(folder):
    """Content and time of every file."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path: (path.stat().st_mtime_ns, hashlib.sha256(path.read_bytes()).digest()) for path in files}


@case("-")
def a_finished_run_changes_nothing(bench):
    run = bench.small_run()
    before = state(run)
    for sets in [[], ["topology.actors=1"], ["rollouts.seconds=60"], ["run.checkpoint_seconds=1"]]:
        arguments = [word for each in sets for word in ("--set", each)]
        bench.formica("launch", "--resume", "small", *arguments, timeout=5).succeeds(
            "is finished with the normalized score", *(each.split("=")[0] for each in sets)
        )
        assert state(run) == before


@case("-")
def what_shapes_a_run_is_refused_by_key(bench):
    run = bench.small_run()
    before = state(run)
    for change in [
        "run.seed=1", "maze.layout=medium", "encoder.latent=4", "encoder.hidden=[16]", "graph.nodes=30",
        "low.learning_rate=0.1", "high.steps=50000", "high.planner=search", "graph.online=true", "run.algorithm=walker",
        "run.deterministic=true", "run.name=other", "dataset.leave_out=[[1, 2]]", "collect.transitions=20000",
    ]:
        key = change.split("=")[0]
        bench.formica("launch", "--resume", "small", "--set", change, timeout=5).fails(2, key)
        assert state(run) == before
    told = bench.formica("launch", "--resume", "small", "--set", "graph.nodes=30", "--set", "topology.actors=1")
    told.fails(2, "--set graph.nodes: cannot change from 20 to 30").never_says("topology.actors")


@case("-")
def an_edited_config_is_checked_with_its_lines(bench):
    run = bench.small_run()
    config = run / "config.toml"
    sound = config.read_text()
    line = sound.split("\n").index("nodes = 20") + 1
    for old, new, told in [
        ("nodes = 20", "nodes = 30", f"runs/small/config.toml:{line}: graph.nodes: cannot change from 20 to 30"),
        ("nodes = 20", "nodez = 20", f"runs/small/config.toml:{line}: graph.nodez: unknown key"),
        ("nodes = 20", "nodes = ", f"runs/small/config.toml:{line}: "),
    ]:
        config.write_text(sound.replace(old, new))
        bench.formica("launch", "--resume", "small", timeout=5).fails(2, told)
    config.unlink()
    bench.formica("launch", "--resume", "small", timeout=5).fails(1, "config.toml is missing", "cp runs/small/")


@case("-")
def more_episodes_are_played_on_the_same_weights(bench):
    run = bench.small_run()
    graph, weights = (run / "graph.bin").read_bytes(), run / "checkpoints" / "low.safetensors"
    before = weights.read_bytes()
    bench.formica("launch", "--resume", "small", "--set", "evaluation.episodes=12").succeeds(
        "config: evaluation.episodes: 8 -> 12", "8 of them known", "12 episodes"
    )
    assert (run / "graph.bin").read_bytes() == graph
    # Its header names the config.
    assert weights.read_bytes()[-10000:] == before[-10000:]
    assert len((run / "episodes.csv").read_text().splitlines()) == 13


@case("lightning-pose#195")
def a_run_goes_on_from_anywhere_after_it_was_moved(bench):
    bench.write("a/small.toml", SMALL)
    bench.shell(
        'cd a; "$F" launch small.toml --set low.updates=3000 & until [ -f runs/small/checkpoints/encoder.safetensors ]; '
        "do sleep 0.1; done; kill -TERM $!; wait $!"
    ).fails(130, "ended by signal")
    (bench.folder / "a").rename(bench.folder / "b")
    for part in ["logs", "traces"]:
        shutil.rmtree(bench.folder / "b" / "runs" / "small" / part)
    (bench.folder / "c").mkdir()
    told = bench.formica("launch", "--resume", "../b/runs/latest", cwd=bench.folder / "c")
    told.succeeds("dataset.path moved with the run to", "normalized score")
    assert not list((bench.folder / "c").iterdir())


@case("-")
def a_data_set_that_was_exchanged_is_refused(bench):
    bench.small_run()
    bench.write("data.hdf5", b"other")
    more = ["launch", "--resume", "small", "--set", "evaluation.episodes=9", "--set", "dataset.path=data.hdf5"]
    bench.formica(*more, timeout=10).fails(2, "holds other data than the run began with")
