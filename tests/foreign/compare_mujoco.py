#!/usr/bin/env python3
"""Lays the ant in rapier beside the same ant in MuJoCo, under the same actions.

Usage: compare_mujoco.py [--episodes 60] [--policy D4RL.npz] [--output docs/fidelity.md]
Needs: pip install mujoco ogbench numpy      (OGBench's ant.xml has D4RL's physics)
       cargo build --release -p maze --example pipe

--policy: a goal-reaching policy as arrays (fc0, fc1, last_fc: weight and bias) of D4RL's
rlkit network: 27 proprioceptive values and a goal vector of length 10, ReLU, tanh.
"""

import argparse
import json
import pathlib
import struct
import subprocess
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import ogbench

ROOT = pathlib.Path(__file__).resolve().parents[2]
MEDIUM = ["11111111", "10011001", "10010001", "11000111", "10010001", "10100101", "10001001", "11111111"]
LEVELS = [0.5, 0.9, 0.99, 0.999, 1.0]
# Episodes begin with the ankles 30 degrees outside their range (control steps).
SETTLING = 10


class Rapier:
    """The simulator of this project, behind a pipe."""

    name = "rapier"

    def __init__(self, maze):
        binary = ROOT / "target/release/examples/pipe"
        self.process = subprocess.Popen([binary, maze], stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def ask(self, command, values, answer):
        self.process.stdin.write(command + np.asarray(values, "<f4").tobytes())
        self.process.stdin.flush()
        return np.frombuffer(self.process.stdout.read(4 * answer), "<f4").astype(float)

    def set(self, observation):
        return self.ask(b"S", observation, 29)

    def step(self, action):
        return self.ask(b"A", action, 29)

    def inertias(self):
        return self.ask(b"M", [], 36).reshape(9, 4)


class MuJoCo:
    """The same ant in MuJoCo, as D4RL steps it: RK4, five steps of 0.02 s."""

    name = "MuJoCo"

    def __init__(self, maze):
        path = pathlib.Path(ogbench.__file__).parent / "locomaze/assets/ant.xml"
        tree = ElementTree.parse(path)
        world = tree.find("worldbody")
        for row, cells in enumerate(MEDIUM if maze == "medium" else []):
            for column, cell in enumerate(cells):
                if cell == "1":
                    place = f"{4 * (column - 1)} {4 * (row - 1)} 1"
                    box = dict(type="box", pos=place, size="2 2 1", contype="1", conaffinity="1")
                    ElementTree.SubElement(world, "geom", box)
        self.model = mujoco.MjModel.from_xml_string(ElementTree.tostring(tree.getroot(), encoding="unicode"))
        self.data = mujoco.MjData(self.model)

    def observe(self):
        return np.concatenate([self.data.qpos[:15], self.data.qvel])

    def set(self, observation):
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = observation[:15], observation[15:]
        mujoco.mj_normalizeQuat(self.model, self.data.qpos)
        return self.observe()

    def step(self, action):
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data, 5)
        return self.observe()

    def inertias(self):
        # Fixed bodies of the XML count to the torso; hips and feet come in leg order.
        bodies = range(1, self.model.nbody)
        moving = [b for b in bodies if self.model.body_dofnum[b] > 0]
        rows = [[self.model.body_mass[b], *self.model.body_inertia[b]] for b in moving]
        for b in bodies:
            if self.model.body_dofnum[b] == 0:
                rows[0][0] += self.model.body_mass[b]
        return np.array(rows)


def rest(place=(0.0, 0.0)):
    return np.array([*place, 0.75, 1.0, 0, 0, 0, *[0] * 8, *[0] * 14], float)


def noisy(rng, place):
    start = rest(place)
    start[:15] += rng.uniform(-0.1, 0.1, 15)
    start[15:] += 0.1 * rng.normal(size=14)
    return start


def upright(o):
    return 1 - 2 * (o[..., 4] ** 2 + o[..., 5] ** 2)


def random_actions(simulator, episodes, limits):
    rng = np.random.default_rng(0)
    cells = [(4.0 * (c - 1), 4.0 * (r - 1)) for r in range(8) for c in range(8) if MEDIUM[r][c] == "0"]
    rows = []
    for _ in range(episodes):
        simulator.set(noisy(rng, cells[rng.integers(len(cells))]))
        rows.append([simulator.step(a) for a in rng.uniform(-1, 1, (1000, 8))])
    o = np.array(rows)
    low, high = limits
    joints = o[:, SETTLING:, 7:15]
    over = np.degrees(np.maximum(low - joints, joints - high).max(-1)).ravel()
    speed = np.hypot(o[..., 15], o[..., 16])
    return {
        "torso height (m): 1, 50, 99, 100%": np.quantile(o[..., 2], [0.01, 0.5, 0.99, 1]),
        "speed (m/s): 50, 90, 99, 99.9, 100%": np.quantile(speed, LEVELS),
        "worst joint past its limit (degrees): 50, 90, 99, 99.9, 100%": np.quantile(over, LEVELS),
        "hips reached (degrees): 0.1, 99.9%": np.degrees(np.quantile(joints[..., 0::2], [0.001, 0.999])),
        "ankles reached (degrees): 0.1, 99.9%": np.degrees(np.quantile(np.abs(joints[..., 1::2]), [0.001, 0.999])),
        "joint speed (rad/s): 50, 90, 99%": np.quantile(np.abs(o[:, SETTLING:, 21:29]), [0.5, 0.9, 0.99]),
        "way of an episode (m): 50, 90%": np.quantile(np.hypot(*(o[:, -1, :2] - o[:, 0, :2]).T), [0.5, 0.9]),
        "share of time on the back": [np.mean(upright(o) < 0)],
    }


def walker():
    """The shipped walker, as `maze::Egocentric` and `agents::walker` have it."""
    raw = (ROOT / "assets/walker.safetensors").read_bytes()
    (length,) = struct.unpack("<Q", raw[:8])
    header = json.loads(raw[8 : 8 + length])
    tensors = {}
    for name, about in header.items():
        if name != "__metadata__":
            begin, end = about["data_offsets"]
            data = np.frombuffer(raw[8 + length + begin : 8 + length + end], "<f4")
            tensors[name] = data.reshape(about["shape"]).astype(float)
    layers = len([name for name in tensors if name.endswith(".weight")])
    sign = np.array([1, -1, -1, 1])
    joint_of_actuator = [6, 7, 0, 1, 2, 3, 4, 5]

    def act(o, direction):
        w, x, y, z = o[3:7]
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        heading = np.arctan2(rotation[1, 0], rotation[0, 0])
        angle = np.arctan2(direction[1], direction[0]) - heading
        quarter = int(np.round(angle / (np.pi / 2))) % 4
        back = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])
        turn = np.linalg.matrix_power(back, quarter)
        legs = [(slot + quarter) % 4 for slot in range(4)]
        q, v = o[7:15].reshape(4, 2)[legs], o[21:29].reshape(4, 2)[legs]
        bend = np.stack([np.ones(4), sign[legs]], 1)
        features = np.concatenate(
            [
                [(o[2] - 0.55) / 0.2],
                turn @ rotation.T @ [0, 0, 1],
                (q * bend).ravel(),
                0.5 * turn @ rotation.T @ o[15:18],
                0.25 * turn @ o[18:21],
                0.15 * (v * bend).ravel(),
                (turn @ [np.cos(angle), np.sin(angle), 0])[:2],
            ]
        )
        for layer in range(layers):
            features = features @ tensors[f"policy.{layer}.weight"] + tensors[f"policy.{layer}.bias"]
            if layer + 1 < layers:
                features = np.tanh(features)
        action = np.zeros(8)
        for actuator, joint in enumerate(joint_of_actuator):
            leg, kind = divmod(joint, 2)
            slot = (leg - quarter) % 4
            action[actuator] = features[2 * slot + kind] * (sign[leg] if kind else 1)
        return np.clip(action, -1, 1)

    return act


def d4rl(path):
    p = {name: array.astype(float) for name, array in np.load(path).items()}

    def act(o, direction):
        x = np.concatenate([o[2:], 10 * np.asarray(direction)])
        for layer in ("fc0", "fc1"):
            x = np.maximum(p[f"{layer}.weight"] @ x + p[f"{layer}.bias"], 0)
        return np.tanh(p["last_fc.weight"] @ x + p["last_fc.bias"])

    return act


def gait(simulator, act, name, directions=32, steps=200):
    rng = np.random.default_rng(1)
    speeds, heights, fallen = [], [], 0
    for k in range(directions):
        angle = 2 * np.pi * k / directions
        direction = np.array([np.cos(angle), np.sin(angle)])
        o = simulator.set(noisy(rng, (0, 0)))
        for step in range(steps):
            after = simulator.step(act(o, direction))
            if upright(after) < 0:
                fallen += 1
                break
            if step >= 20:
                speeds.append((after[:2] - o[:2]) @ direction)
                heights.append(after[2])
            o = after
    return {
        f"{name}: way towards the target (m a control step)": [np.mean(speeds)],
        f"{name}: torso height (m): 5, 50, 95%": np.quantile(heights, [0.05, 0.5, 0.95]),
        f"{name}: falls in {directions} walks of {steps} steps": [fallen],
    }


def references(simulator):
    """No torque from the reset pose, and 30 N m on hip 1."""
    simulator.set(rest())
    still = np.array([simulator.step(np.zeros(8)) for _ in range(60)])
    push = np.zeros(8)
    push[2] = 1
    simulator.set(rest())
    hip = np.array([simulator.step(push) for _ in range(12)])
    return {
        "no torque: torso height (m) after 1, 2, 3, 4, 5, 6, 8, 10 steps": still[[0, 1, 2, 3, 4, 5, 7, 9], 2],
        "no torque: settled height (m) after 20, 60 steps": still[[19, 59], 2],
        "no torque: ankle 1 (rad) after 1, 2, 3, 4, 10, 60 steps": still[[0, 1, 2, 3, 9, 59], 8],
        "no torque: ankle 1 (rad/s) after 1, 2, 3 steps": still[[0, 1, 2], 22],
        "30 N m on hip 1 (rad) after 1, 2, 3, 4, 12 steps": hip[[0, 1, 2, 3, 11], 7],
        "30 N m on hip 1 (rad/s) after 1, 2 steps": hip[[0, 1], 21],
    }


def table(columns):
    lines = ["| | " + " | ".join(columns) + " |", "|---" * (1 + len(columns)) + "|"]
    first = next(iter(columns.values()))
    for key in first:
        cells = [", ".join(f"{v:.3g}" for v in column[key]) for column in columns.values()]
        lines.append(f"| {key} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("--episodes", type=int, default=60)
    arguments.add_argument("--policy")
    arguments.add_argument("--output")
    given = arguments.parse_args()
    columns = {}
    limits = MuJoCo("floor").model.jnt_range[1:].T
    for kind in (MuJoCo, Rapier):
        floor, maze = kind("floor"), kind("medium")
        values = {}
        torso, *legs = floor.inertias()
        values["mass (kg): torso, hip links, foot links, all"] = [
            torso[0], legs[0][0], legs[1][0], torso[0] + sum(leg[0] for leg in legs),
        ]
        values["inertia (kg m^2): hip link, foot link, along and across"] = [
            *np.sort(legs[0][1:])[[0, 2]], *np.sort(legs[1][1:])[[0, 2]],
        ]
        values |= references(floor)
        values |= random_actions(maze, given.episodes, limits)
        values |= gait(floor, walker(), "shipped walker")
        if given.policy:
            values |= gait(floor, d4rl(given.policy), "D4RL's policy")
        columns[kind.name] = values
    text = table(columns)
    print(text)
    if given.output:
        path = pathlib.Path(given.output)
        before, _, after = path.read_text().partition("<!-- table -->\n")
        _, _, after = after.partition("<!-- end of table -->")
        path.write_text(f"{before}<!-- table -->\n{text}\n<!-- end of table -->{after}")


if __name__ == "__main__":
    main()
