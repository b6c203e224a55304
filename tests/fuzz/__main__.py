"""``make fuzz``: millions of changed inputs for every decoder, and for every port of a running rig.

python -m tests.fuzz [NAME ...] [--count 2000000] [--seed N] [--minutes 30]
"""

import argparse
import sys
import time

from tests.fuzz.decoders import BATCH, DECODERS, Target
from tests.fuzz.mutator import Mutator, keep
from tests.fuzz.ports import PORTS, flood

COUNT = 2_000_000


def fuzz(target: Target, count: int, seed: int, minutes: float) -> str:
    """Return what became of ``count`` inputs, or of as many as there was time for; keep what fails."""
    mutator, done = Mutator(target.valid(), seed, text=target.text), 0
    start = time.monotonic()
    while done < count and time.monotonic() - start < 60 * minutes:
        inputs = [mutator.next() for _ in range(BATCH)]
        try:
            target.check(inputs)
        except Exception as error:
            return f"FAILED after {done:,}: {type(error).__name__}: {error}; kept {_guilty(target, inputs)} seeds"
        done += BATCH
    return f"{done:,} inputs in {time.monotonic() - start:.0f} s: nothing found"


def _guilty(target: Target, inputs: list[bytes]) -> int:
    """Keep those of the inputs that fail alone in a new decoder, else all of them; return how many."""
    alone = []
    for data in inputs:
        try:
            type(target)().check([data])
        except Exception:
            alone.append(data)
    for data in alone or inputs:
        keep(target.name, data)
    return len(alone or inputs)


def main() -> int:
    """Fuzz the named targets, or all; return 1 if a fault was found."""
    decoders = {make.name: make for make in DECODERS}
    parser = argparse.ArgumentParser(description="Feed changed inputs to decoders and ports.")
    parser.add_argument("names", nargs="*", choices=[[], *decoders, *PORTS])
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=30.0, help="at the most, for each")
    options = parser.parse_args()
    failed = False
    for name in options.names or [*decoders, *PORTS]:
        if name in decoders:
            result = fuzz(decoders[name](), options.count, options.seed, options.minutes)
        else:
            result = flood(name, options.count, options.seed, options.minutes)
        print(f"{name:>14}  {result}", flush=True)
        failed |= "FAILED" in result
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
