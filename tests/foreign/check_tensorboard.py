"""Reads the event files of runs with TensorBoard's own reader and compares every scalar with metrics.csv.

    pip install tensorboard
    python3 tests/foreign/check_tensorboard.py runs/quickstart [RUN...]
"""

import csv
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator


def expected(run):
    """Steps and values of each source and name, in the order of the file."""
    rows = defaultdict(list)
    with open(run / "metrics.csv", newline="") as file:
        for row in csv.DictReader(file):
            key = (row["role"], row["id"], row["name"])
            rows[key].append((int(row["step"]), np.float32(row["value"])))
    return rows


def check(run):
    events = EventAccumulator(str(run / "tensorboard"), size_guidance={"scalars": 0})
    events.Reload()
    found = set(events.Tags()["scalars"])
    rows = expected(run)
    assert rows, f"{run}: metrics.csv is empty"
    faults = []
    for (role, id, name), wanted in rows.items():
        # A name that several ids can send has role and id before it.
        tag = next((tag for tag in (f"{role}-{id}/{name}", name) if tag in found), None)
        if tag is None:
            faults.append(f"{name} of {role} {id} is missing")
            continue
        found.remove(tag)
        scalars = events.Scalars(tag)
        got = [(scalar.step, np.float32(scalar.value)) for scalar in scalars]
        if got != wanted:
            faults.append(f"{tag}: {len(got)} scalars differ from {len(wanted)} rows")
        times = [scalar.wall_time for scalar in scalars]
        if times != sorted(times):
            faults.append(f"{tag}: time runs backwards")
    faults += [f"{tag} is not in metrics.csv" for tag in found]
    if events.file_version != 2.0:
        faults.append(f"file version {events.file_version}")
    files = len(list((run / "tensorboard").iterdir()))
    for fault in faults:
        print(f"{run}: {fault}")
    total = sum(map(len, rows.values()))
    print(f"{run}: {total} scalars of {len(rows)} sources in {files} files, {len(faults)} faults")
    return not faults


if __name__ == "__main__":
    runs = [Path(argument) for argument in sys.argv[1:]]
    if not runs:
        sys.exit(__doc__)
    sys.exit(0 if all([check(run) for run in runs]) else 1)
