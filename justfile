# Everyday commands

default:
    @just --list

# A first run, to its score
quickstart:
    cargo run --release -- launch configs/quickstart.toml

# All tests
test:
    cargo test --workspace

# What a change must pass
ci:
    bash .ci/run

# Which crate may depend on which, no import circles, no file over 500 lines
structure:
    python3 tests/structure.py

# How well the walker walks, and how far a perfect planner gets with it
ceiling maze="large":
    cargo run --release -- ceiling configs/antmaze-{{maze}}-diverse.toml --episodes 300

# Every role killed hundreds of times, at any moment; about an hour (docs/reliability.md)
chaos:
    cargo test --package system-tests --test chaos -- --ignored long_kills --nocapture --test-threads 1

# An hour of full load: memory, descriptors, throughput
soak:
    cargo test --package system-tests --test soak -- --ignored long_soak --nocapture

# `formica watch`, which CI does not build: checked, built, and asked by a client (PyPI's websockets)
live run:
    cargo clippy --workspace --all-targets --features launcher/live -- -D warnings
    cargo build --workspace --features launcher/live
    ./target/debug/formica watch {{run}} & watch=$!; sleep 2; \
      python3 tests/foreign/check_watch.py; code=$?; kill -INT $watch; exit $code

# What a trace costs the simulation that is traced
slowdown:
    cargo run --release -p trace --example slowdown

# A small run's files, read by the tools of others (PyPI's mcap, rerun-sdk, tensorboard)
foreign:
    cargo build --workspace
    bash tests/foreign/run

# Cases that users of similar tools reported in public, tried on the binary; all of a kind or by name
cases *names:
    cargo build --workspace
    bash tests/cases/run target/debug/formica {{names}}

# Dependencies against the rules of deny.toml (needs cargo-deny)
deny:
    cargo deny check

# A fuzz target (d4rl, minari, ogbench, trace) for ten minutes (needs cargo-fuzz)
fuzz target:
    mkdir -p fuzz/found/{{target}}
    RUSTC_BOOTSTRAP=1 cargo fuzz run {{target}} --sanitizer none fuzz/found/{{target}} fuzz/corpus/{{target}} -- -max_len=16384 -max_total_time=600

# 100,000 run files changed at random, through the whole of a check
fuzz-config cases="100000":
    FORMICA_FUZZ_CASES={{cases}} cargo test --package launcher check::fuzz -- --nocapture

# Five seeds in a maze, their scores and the picture of their learning curves
seeds maze="large":
    for seed in 0 1 2 3 4; do \
      cargo run --release -- launch configs/antmaze-{{maze}}-diverse.toml \
        --set run.seed=$seed --set run.name={{maze}}-seed$seed || exit 1; \
    done
    cargo run --release -- curves runs/{{maze}}-seed[0-4] --out curves-{{maze}}.svg

# One of the large maze's ablations on the stages of a run (docs/learning.md has the list), as in
# `just ablation runs/large-seed0 search --set high.planner=search`
ablation run name *sets:
    cargo run --release -- launch configs/antmaze-large-diverse.toml --set run.name={{name}} \
      --set encoder.from={{run}}/checkpoints/encoder.safetensors \
      --set low.from={{run}}/checkpoints/low.safetensors \
      --set rollouts.seconds=30 --set evaluation.episodes=200 {{sets}}
