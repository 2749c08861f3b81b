#!/usr/bin/env python3
"""Control steps a second of the ant in D4RL's medium maze: rapier, MuJoCo and Gymnasium in one run.

Usage: bench_mujoco.py [--seconds 5]     exit code 1 where a ratio falls short
Needs: pip install mujoco ogbench gymnasium-robotics numpy
       cargo build --release -p maze --example speed

A control step is D4RL's: 0.1 s, in MuJoCo five RK4 steps of 0.02 s. MuJoCo runs through its own
rollout module, in C, on one thread; Gymnasium's env.step is that of Gymnasium-Robotics' AntMaze
(five RK4 steps, too). The three take turns, three rounds, and the best of each counts.
"""

import argparse
import json
import subprocess
import sys
import time

import gymnasium
import gymnasium_robotics
import mujoco
import numpy as np
from compare_mujoco import ROOT, MuJoCo
from mujoco import rollout

WANTED = {"MuJoCo, raw": 3.0, "Gymnasium, env.step": 5.0}


def raw(seconds):
    simulator = MuJoCo("medium")
    model, data = simulator.model, simulator.data
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.zeros((1, mujoco.mj_stateSize(model, kind)))
    mujoco.mj_resetData(model, data)
    mujoco.mj_getState(model, data, state[0], kind)
    rng = np.random.default_rng(0)
    steps, start = 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        control = np.repeat(rng.uniform(-1, 1, (1000, 8)), 5, axis=0)[None]
        rollout.rollout(model, data, state, control)
        steps += 1000
    return steps / (time.perf_counter() - start)


def env_step(seconds):
    gymnasium.register_envs(gymnasium_robotics)
    env = gymnasium.make("AntMaze_Medium-v5", max_episode_steps=1000)
    env.reset(seed=0)
    steps, start = 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        for _ in range(100):
            *_, truncated, _ = env.step(env.action_space.sample())
            if truncated:
                env.reset()
        steps += 100
    return steps / (time.perf_counter() - start)


def ours(seconds):
    binary = ROOT / "target/release/examples/speed"
    return json.loads(subprocess.check_output([binary, str(seconds)]))


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("--seconds", type=float, default=5.0)
    seconds = arguments.parse_args().seconds
    rounds = [(ours(seconds), raw(seconds), env_step(seconds)) for _ in range(3)]
    one = max(r[0]["one_thread"] for r in rounds)
    two = max(r[0]["two_threads"] for r in rounds)
    peers = {"MuJoCo, raw": max(r[1] for r in rounds), "Gymnasium, env.step": max(r[2] for r in rounds)}
    print(f"rapier, one thread   {one:8.0f} control steps/s")
    print(f"rapier, two threads  {two:8.0f}, {two / one:.2f} times one")
    print(f"memory of an ant     {rounds[0][0]['kib_an_ant']:8.1f} KiB")
    short = False
    for name, rate in peers.items():
        print(f"{name:20} {rate:8.0f}; rapier is {one / rate:.2f} times as fast, {WANTED[name]:.0f} wanted")
        short |= one / rate < WANTED[name]
    sys.exit(int(short))


if __name__ == "__main__":
    main()
