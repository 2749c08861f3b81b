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

# How well the walker walks, and how far a perfect planner gets with it
ceiling maze="large":
    cargo run --release -- ceiling configs/antmaze-{{maze}}-diverse.toml --episodes 300

# Dependencies against the rules of deny.toml (needs cargo-deny)
deny:
    cargo deny check
