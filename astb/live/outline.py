"""The steps of a plan from its last run or rehearsal, because a plan is a program without a list of steps."""

from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from stat import S_ISREG
from typing import Final, NamedTuple

from bench_records.layout import RESULT, Phase, RecordError
from bench_records.result import Outcome, read_result

#: Number of earlier runs that are searched for the same parameters.
_LOOKED_AT: Final = 5
#: A result begins with the name of its plan (bytes).
_HEAD: Final = 200


class Outline(NamedTuple):
    """The steps of an earlier run of the same plan, and which run that was."""

    phases: tuple[Phase, ...]
    source: str


NONE: Final = Outline((), "")


def kept_outline(out: Path, plan: str, parameters: dict[str, str]) -> Outline:
    """Return the steps of the newest run or rehearsal of ``plan`` in ``out`` with these parameters, or `NONE`.

    A blocked run has only the first steps, and is ignored.
    """
    if not out.is_dir():
        return NONE
    results = (one / RESULT for one in out.iterdir())
    kept = {path: when for path in results if (when := _written(path))}
    for path in islice(
        (one for one in sorted(kept, key=kept.__getitem__)[::-1] if _is_of(one, plan)), _LOOKED_AT
    ):
        try:
            result = read_result(path.parent)
        except RecordError:
            continue
        same = result.plan == plan and result.parameters == parameters
        if same and result.verdict is not Outcome.BLOCKED:
            return Outline(tuple(result.phases), path.parent.name)
    return NONE


def _written(path: Path) -> int:
    """Return the time at which a file was written (ns since 1970), 0 if there is none."""
    try:
        status = path.stat()
    except OSError:
        return 0
    return status.st_mtime_ns if S_ISREG(status.st_mode) else 0


def _is_of(path: Path, plan: str) -> bool:
    """Return whether a result is of ``plan``, by its first lines, because a run may have been renamed."""
    try:
        with path.open("rb") as file:
            return f'"plan": "{plan}"'.encode() in file.read(_HEAD)
    except OSError:
        return False


class Follower:
    """Finds the present step of a run in the outline of an earlier one."""

    def __init__(self, outline: Outline) -> None:
        self._phases: Sequence[Phase] = outline.phases
        self._end = max((phase.end for phase in outline.phases), default=0.0)
        self._at = -1
        self._known = False

    def begin(self, name: str, level: int) -> None:
        """Record the begin of a step. After a step that the outline lacks, the next step is unknown."""
        for place in range(self._at + 1, len(self._phases)):
            if (self._phases[place].name, self._phases[place].level) == (name, level):
                self._at, self._known = place, True
                return
        self._known = False

    @property
    def next(self) -> str:
        """The next step; "" if it is unknown, or the last one runs."""
        if not self._known or self._at + 1 >= len(self._phases):
            return ""
        return self._phases[self._at + 1].name

    def left(self, in_step: float) -> float | None:
        """Return the remaining time of the run (s), ``in_step`` s after the present step began; None if unknown."""
        if not self._known:
            return None
        present = self._phases[self._at]
        return max(0.0, self._end - min(present.start + in_step, present.end))
