"""What a process cannot see is not dead: other mounts, other places, other users, small limits."""
import os
import pathlib
import subprocess

from harness import SMALL, case

USER = os.getuid()
SHARED = pathlib.Path("/dev/shm")


def unshared(bench, script, options="-m --propagation private"):
    """Runs a script in namespaces of its own; none where this machine does not let us."""
    if subprocess.run(["unshare", *options.split(), "true"], stderr=subprocess.DEVNULL).returncode:
        print(f"this machine does not let us unshare {options}; not tried")
        return None
    return bench.shell(f"exec unshare {options} bash -c '{script}'")


@case("moby#12046")
def files_of_a_run_whose_lock_is_not_seen_are_left_alone(bench):
    # As a run of another version, seen from another /tmp, looks: files in shared memory and no lock.
    path = SHARED / f"formica{USER}_0badcafe_case"
    path.write_bytes(b"alive elsewhere")
    try:
        bench.formica("doctor").says("run 0badcafe", "left alone", "no lock of it is visible", "doctor --clear 0badcafe")
        assert path.exists(), "it was cleared"
        bench.write("runs/small/domain", "0badcafe")
        bench.formica("actor", "--attach", "small").fails(1, "not visible from here", f"/tmp/formica-{USER}/0badcafe")
        bench.formica("doctor", "--clear", "0badcafe").says("run 0badcafe", "cleared")
        assert not path.exists(), "its user said so"
    finally:
        path.unlink(missing_ok=True)


@case("moby#12046")
def a_lock_that_is_held_is_seen_from_another_tmp(bench):
    script = f"""
      exec 9>/dev/shm/formica{USER}_0badcaff_lock; flock 9
      touch /dev/shm/formica{USER}_0badcaff_data
      unshare -m --propagation private bash -c "mount -t tmpfs none /tmp; $F doctor; $F doctor --clear 0badcaff" 9>&-
      ls /dev/shm/formica{USER}_0badcaff_data && flock -u 9 && $F doctor
      rm -f /dev/shm/formica{USER}_0badcaff_*"""
    if unshared(bench, "true") is None:
        return
    told = bench.shell(script).says("0badcaff", ", alive", "not cleared: a process holds it", "_data\n", "dead: cleared")
    assert told.text.index(", alive") < told.text.index("dead: cleared"), told


@case("systemd PrivateTmp")
def a_run_that_is_alive_elsewhere_is_not_said_to_be_dead(bench):
    bench.write("runs/small/domain", "0badcafd")
    bench.shell("flock runs/small/lock $F actor --attach small").fails(
        1, "is alive, but its channels are not visible from here", "/dev/shm", "/tmp").never_says("--resume")


@case("ray#13606")
def channels_do_not_lie_where_tmpdir_says(bench):
    bench.formica("doctor", env={"TMPDIR": str(bench.folder / "none"), "HOME": None}).says("/tmp ").never_says("none ")


@case("ray#13606")
def no_shared_memory_is_named_with_what_to_do(bench):
    bench.write("small.toml", SMALL)
    for made, fault in [("umount -l /dev/shm; rmdir /dev/shm 2>/dev/null; mount -t tmpfs -o ro none /dev/shm", "read-only"),
                        ("mount -t tmpfs none /dev; mknod -m 666 /dev/null c 1 3; mknod -m 666 /dev/urandom c 1 9", "it is not there")]:
        told = unshared(bench, f"{made}; $F check small.toml; $F doctor")
        if told:
            told.says("'/dev/shm'", fault, "--shm-size")


@case("-")
def an_open_file_limit_is_named(bench):
    bench.write("small.toml", SMALL)
    bench.shell("ulimit -n 64; $F check small.toml").fails(1, "64 open files", "ulimit -n").never_says("InternalFailure")
    bench.shell("ulimit -Sn 64; $F check small.toml").succeeds("no fault found")


@case("-")
def another_users_folder_is_named(bench):
    script = "mount -t tmpfs none /tmp; mkdir /tmp/formica-0; chown 12345 /tmp/formica-0; $F doctor"
    told = unshared(bench, script) if USER == 0 else None
    if told:
        told.fails(1, "/tmp/formica-0", "number 12345")
