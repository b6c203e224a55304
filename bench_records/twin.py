"""What the model that ran beside a run said of it, kept in the run's directory."""

from pathlib import Path
from typing import Final

import msgspec

from bench_protocol.input_limits import RESULT_BYTES, read_bounded
from bench_records.disk import kept
from bench_records.layout import RecordError, put

TWIN: Final = "twin.json"
#: The parts of a summary, in order, as people read them.
PARTS: Final = {
    "wrong": "What is wrong",
    "sure": "How sure",
    "evidence": "Evidence",
    "next": "What to do next",
}


class Judged(msgspec.Struct, frozen=True):
    """A part of the run, in s: the rig agreed with its model, or did not, or nobody can say (``why``)."""

    start: float
    end: float
    along: bool | None
    why: str = ""


class PossibleCause(msgspec.Struct, frozen=True):
    """A cause with which the model agrees with the rig; size and interval (k = 2) in SI, times in s of the run."""

    name: str
    title: str
    size: float  #: where it grows, the last one
    low: float
    high: float
    shown: str  #: size and interval as people read them
    form: str = "at once"  #: or "growing", or "gone again"
    since: float | None = None  #: None of one that was there when the model began to look
    until: float | None = None  #: when it had grown to its size, or was gone; None: not yet


class Said(msgspec.Struct, frozen=True):
    """What was said of a parting when the run had come to ``at`` s: one word, and what could explain it then.

    *told* at first, before anybody looks for causes where that takes long; then *explained*, or *unknown* where nothing
    of the catalogue does so; *surer* where fewer causes are left or the size is known better; *otherwise* where the
    causes, their forms or sizes are others; *withdrawn* where what came since makes it no parting; *over* where the rig
    agrees again.
    """

    at: float
    word: str
    causes: tuple[PossibleCause, ...] = ()
    pairs: tuple[tuple[PossibleCause, PossibleCause], ...] = ()


class Summary(msgspec.Struct, frozen=True):
    """The first screen of a parting: what is wrong and how large, how sure, what proves it, what to do next."""

    wrong: str
    sure: str
    evidence: str
    next: str


class Parting(msgspec.Struct, frozen=True):
    """Rig and model part: told at ``told`` s, begun about ``since`` s, first in ``channel`` (values in SI).

    ``measured``, ``expected`` and ``band`` (k = 2) are means over the block in which it was told. Each of ``causes``
    explains it alone. Where there is none, each of ``pairs`` does so together; without these nothing does.
    """

    told: float
    since: float
    channel: str
    measured: float
    expected: float
    band: float
    causes: tuple[PossibleCause, ...] = ()
    sentence: str = ""
    earliest: float | None = None  #: with a cause, the interval (k = 2) in which it began; None without
    latest: float | None = None
    pairs: tuple[tuple[PossibleCause, PossibleCause], ...] = ()
    course: tuple[Said, ...] = ()  #: how it went, in order
    over: float | None = None  #: from when on (s) the rig agrees again, at the latest
    withdrawn: bool = False
    searched: bool = True  #: False as long as nobody has looked for causes
    summary: Summary | None = None  #: None in stories of earlier versions

    @property
    def lasts(self) -> bool:
        """Whether rig and model still part, as far as is known."""
        return self.over is None and not self.withdrawn


class Compared(msgspec.Struct, frozen=True):
    """A channel beside its model in blocks of time (SI): mean reading, what was expected, and the band (k = 2) of that.

    None where nothing was read.
    """

    channel: str
    measured: tuple[float | None, ...]
    expected: tuple[float | None, ...]
    band: tuple[float | None, ...]


class LastMinute(msgspec.Struct, frozen=True):
    """All channels in the last minute that could be judged; ``times`` are the middles of blocks, in s of the run.

    Between two stretches stands a block in which nothing was read.
    """

    times: tuple[float, ...]
    channels: tuple[Compared, ...]


class TwinStory(msgspec.Struct, frozen=True):
    """All that was said of a run until ``until`` s; ``model`` is the parameter set or file that ran beside it."""

    model: str
    until: float
    judged: tuple[Judged, ...] = ()
    partings: tuple[Parting, ...] = ()
    lately: LastMinute | None = None  #: None if nothing could be judged yet

    @property
    def judged_for(self) -> float:
        """Seconds of the run that could be judged."""
        return sum(one.end - one.start for one in self.judged if one.along is not None)

    @property
    def deviations(self) -> tuple[Parting, ...]:
        """All partings that were not withdrawn, those that are over included."""
        return tuple(one for one in self.partings if not one.withdrawn)

    @property
    def parted(self) -> Parting | None:
        """The last parting that lasts; None if the rig agrees with its model now."""
        return next((one for one in reversed(self.partings) if one.lasts), None)


def write_twin(directory: Path, story: TwinStory) -> None:
    """Put a story into the directory of its run. ``NotKept`` if the disk refuses it."""
    with kept(directory / TWIN):
        put(directory / TWIN, msgspec.json.format(msgspec.json.encode(story), indent=2) + b"\n")


def read_twin(directory: Path) -> TwinStory | None:
    """Return what was said of a run; None where no model ran beside it. RecordError if the file is damaged."""
    path = directory / TWIN
    if not path.exists():
        return None
    try:
        return msgspec.json.decode(read_bounded(path, RESULT_BYTES), type=TwinStory)
    except (msgspec.MsgspecError, OSError, ValueError) as error:
        raise RecordError(f"{path} is damaged: {error}") from None
