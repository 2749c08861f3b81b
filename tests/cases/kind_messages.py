"""Messages: one sentence with its cause once, the path, and what to do next."""
from harness import case


@case("-")
def the_binary_names_itself(bench):
    bench.formica("--version").succeeds("formica ")
