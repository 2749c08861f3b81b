"""Goes through all cases, two at a time: `run.py BINARY [NAME...]`. Exits with 1 when any fails."""
import concurrent.futures
import importlib
import pathlib
import sys
import tempfile
import time

import harness

here = pathlib.Path(__file__).parent
for module in sorted(here.glob("kind_*.py")):
    importlib.import_module(module.stem)


def attempt(name, function, binary):
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="formica-case-") as folder:
        try:
            function(harness.Bench(binary, folder))
            return name, time.monotonic() - start, None
        except Exception as error:  # A case that cannot be tried has failed.
            return name, time.monotonic() - start, f"{type(error).__name__}: {error}"


def main(binary, wanted):
    start = time.monotonic()
    cases = [case for case in harness.CASES if not wanted or any(word in case[1] or word in case[0] for word in wanted)]
    failed = 0
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        attempts = [pool.submit(attempt, name, function, binary) for _, name, _, function in cases]
        for (module, _, source, _), done in zip(cases, attempts):
            name, seconds, error = done.result()
            print(f"{'FAILED' if error else 'ok':<7}{seconds:5.1f} s  {module.removeprefix('kind_')}: {name.replace('_', ' ')} ({source})", flush=True)
            if error:
                failed += 1
                print(error, flush=True)
    print(f"{len(cases) - failed} of {len(cases)} cases as they should be, in {time.monotonic() - start:.0f} s")
    return 1 if failed or not cases else 0


sys.exit(main(sys.argv[1], sys.argv[2:]))
