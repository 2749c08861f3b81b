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

# A fuzz target (d4rl, minari, ogbench) for ten minutes (needs cargo-fuzz)
fuzz target:
    mkdir -p fuzz/found/{{target}}
    RUSTC_BOOTSTRAP=1 cargo fuzz run {{target}} --sanitizer none fuzz/found/{{target}} fuzz/corpus/{{target}} -- -max_len=16384 -max_total_time=600
