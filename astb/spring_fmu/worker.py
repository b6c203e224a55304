"""The process in which a spring's FMU runs apart from the rig: it begins, and then takes a step when asked.

What the library prints goes to the log of this process. Which call it is in stands in memory that the rig sees, so that
the rig knows it after a crash.
"""

from __future__ import annotations

import os
import pickle
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from astb.spring_fmu.instances import begin, shared, tried
from astb.spring_fmu.keys import SpringFmuError
from astb.spring_fmu.mapping import Plan
from bench_protocol.clock import hurry
from bench_sim.rig.elsewhere import serve

#: As that of the rig's tick, which waits for it.
_PRIORITY = 10


@dataclass(frozen=True, slots=True, eq=False)
class Order:
    """What is to be done with an FMU that lies unpacked in ``folder``: so many steps to ``try``, or ever more."""

    plan: Plan
    folder: Path
    memory: Path
    feeds: npt.NDArray[np.float64]
    steps: int = 0
    asked: int = -1
    answers: int = -1


class _Log(list[str]):
    """What the FMU says, in the log as well."""

    def append(self, text: str) -> None:
        super().append(text)
        print(text, file=sys.stderr, flush=True)


def main() -> None:
    """Begin, answer how that went, and go on."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    order: Order = pickle.load(sys.stdin.buffer)
    kept: Any = None
    taken = np.zeros(0)
    e = shared(order.memory, order.plan)
    try:
        kept = begin(e, order.plan, order.folder, order.feeds, _Log())
        if order.steps:
            taken = tried(e, order.plan, order.feeds, order.steps)
        answer: Any = (True, taken)
    except SpringFmuError as error:
        answer = (False, str(error))
    pickle.dump(answer, answers, protocol=5)
    answers.close()
    if answer[0] and not order.steps:
        hurry(_PRIORITY)
        serve(e, order.asked, order.answers)
    del kept
    os._exit(0)  # no library gets the last word


if __name__ == "__main__":
    main()
