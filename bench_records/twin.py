"""The results of the twin, the model that is simulated in parallel with a run. They are stored in the directory of
the run.
"""

from pathlib import Path
from typing import Final

import msgspec

from bench_protocol.input_limits import RESULT_BYTES, read_bounded
from bench_records.disk import kept
from bench_records.layout import RecordError, put

TWIN: Final = "twin.json"
#: Headings of the parts of a summary, in order.
PARTS: Final = {
    "wrong": "What is wrong",
    "sure": "How sure",
    "evidence": "Evidence",
    "next": "What to do next",
}


class Judged(msgspec.Struct, frozen=True):
    """A part of the run (times in s). ``along`` is whether the rig agreed with its model. It is None if this cannot
    be judged; ``why`` is the reason.
    """

    start: float
    end: float
    along: bool | None
    why: str = ""


class PossibleCause(msgspec.Struct, frozen=True):
    """A cause that explains a deviation. Size and interval (k = 2) are in SI, and times are in s of the run."""

    name: str
    title: str
    size: float  #: the last one, if it grows
    low: float
    high: float
    shown: str  #: size and interval in display units
    form: str = "at once"  #: or "growing", or "gone again"
    since: float | None = None  #: None if it was present when the twin started
    until: float | None = None  #: end of its growth, or of its presence; None: not yet


class DeviationState(msgspec.Struct, frozen=True):
    """State of a deviation at the time ``at`` (s of the run): one word, and the possible causes at that time.

    The words are:

    * *told*: detected; the search for causes may follow later, because it can take long;
    * *explained*: at least one cause explains it;
    * *unknown*: no cause of the catalogue explains it;
    * *surer*: fewer causes are possible, or the size is known better;
    * *otherwise*: the causes, their forms or their sizes have changed;
    * *withdrawn*: later data show that there is no deviation;
    * *over*: the rig agrees with the model again.
    """

    at: float
    word: str
    causes: tuple[PossibleCause, ...] = ()
    pairs: tuple[tuple[PossibleCause, PossibleCause], ...] = ()


class Summary(msgspec.Struct, frozen=True):
    """Summary of a deviation: the fault and its size, the certainty, the evidence, and the next step."""

    wrong: str
    sure: str
    evidence: str
    next: str


class Deviation(msgspec.Struct, frozen=True, rename={"detected": "told"}):
    """A deviation between rig and model. It was detected at ``detected`` s in ``channel``, and began at about
    ``since`` s.

    ``measured``, ``expected`` and ``band`` (k = 2) are means in SI over the time block in which it was detected. Each
    of ``causes`` alone explains the deviation. If there is no such cause, each of ``pairs`` is two causes that
    together explain it. If both are empty, there is no known explanation.
    """

    detected: float
    since: float
    channel: str
    measured: float
    expected: float
    band: float
    causes: tuple[PossibleCause, ...] = ()
    sentence: str = ""
    earliest: float | None = None  #: start of the interval (k = 2) of the begin; None without a cause
    latest: float | None = None
    pairs: tuple[tuple[PossibleCause, PossibleCause], ...] = ()
    course: tuple[DeviationState, ...] = ()  #: its states, in order of time
    over: float | None = None  #: latest time (s) from which the rig agrees again
    withdrawn: bool = False
    searched: bool = True  #: False before the search for causes
    summary: Summary | None = None  #: None in stories of earlier versions

    @property
    def lasts(self) -> bool:
        """Whether the deviation still lasts, according to the data so far."""
        return self.over is None and not self.withdrawn


class Compared(msgspec.Struct, frozen=True):
    """Means of a channel and of its model over blocks of time (SI): reading, expected value, and band (k = 2).

    A block without readings has None.
    """

    channel: str
    measured: tuple[float | None, ...]
    expected: tuple[float | None, ...]
    band: tuple[float | None, ...]


class LastMinute(msgspec.Struct, frozen=True):
    """All channels in the last minute that could be judged. ``times`` are the middles of the blocks, in s of the run.

    A block without readings separates two judged parts.
    """

    times: tuple[float, ...]
    channels: tuple[Compared, ...]


class TwinStory(msgspec.Struct, frozen=True, rename={"all_deviations": "partings", "last_minute": "lately"}):
    """All results of the twin up to ``until`` s of the run. ``model`` is the name of its parameter set or file."""

    model: str
    until: float
    judged: tuple[Judged, ...] = ()
    all_deviations: tuple[Deviation, ...] = ()
    last_minute: LastMinute | None = None  #: None before the first judged block

    @property
    def judged_for(self) -> float:
        """Return how many seconds of the run could be judged."""
        return sum(one.end - one.start for one in self.judged if one.along is not None)

    @property
    def deviations(self) -> tuple[Deviation, ...]:
        """Return all deviations that were not withdrawn. Deviations that have ended are included."""
        return tuple(one for one in self.all_deviations if not one.withdrawn)

    @property
    def present_deviation(self) -> Deviation | None:
        """Return the latest deviation that still lasts, or None if the rig agrees with its model now."""
        return next((one for one in reversed(self.all_deviations) if one.lasts), None)


def write_twin(directory: Path, story: TwinStory) -> None:
    """Write the results of the twin to the directory of its run. Raises NotKept for a disk error."""
    with kept(directory / TWIN):
        put(directory / TWIN, msgspec.json.format(msgspec.json.encode(story), indent=2) + b"\n")


def read_twin(directory: Path) -> TwinStory | None:
    """Return the results of the twin, or None for a run without a twin. Raises RecordError if the file is damaged."""
    path = directory / TWIN
    if not path.exists():
        return None
    try:
        return msgspec.json.decode(read_bounded(path, RESULT_BYTES), type=TwinStory)
    except (msgspec.MsgspecError, OSError, ValueError) as error:
        raise RecordError(f"{path} is damaged: {error}; delete it to show the run without its twin") from None
