"""Watches a rig like any other client: receives its signals, requests its contacts, and never becomes its commander."""

import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np

from astb.listening import Listening
from astb.live.door import Deaf, NoRun, knock
from astb.panel.envelope import Envelope
from astb.panel.signals import Shown, shown_signals
from astb.rig_file import RigFile, RigFileError
from astb.rig_limits import known_limits
from astb.session import dimensions_of, open_wiring, wiring_of
from bench_protocol.arrays import Ints
from bench_protocol.clock import RealClock
from bench_protocol.runtime import LINUX
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import NS, ms, s
from bench_protocol.words import FAULT_STATES, SIDES, TO_SAFE, LimitKind
from drivers.errors import BenchError, LinkLost
from drivers.reading import Quality, Readings, Sample
from drivers.settings import UNKNOWN

if TYPE_CHECKING:
    from bench_protocol.arrays import Floats
from bench_records.layout import RecordError
from bench_records.twin import TWIN, read_twin


class TwinReader:
    """Reads the findings of the twin of the present run, and reads them again when the file has changed."""

    def __init__(self) -> None:
        self._read: tuple[Path, int] | None = None
        self._story: dict[str, Any] | None = None

    def story(self, record: str) -> dict[str, Any] | None:
        """Return the findings of the twin of the run in the directory ``record``; None if there are none."""
        path = Path(record) / TWIN
        try:
            now = path, path.stat().st_mtime_ns
        except OSError:
            return None
        if now != self._read:
            try:
                story = read_twin(path.parent)
            except RecordError:
                story = None
            self._read = now
            self._story = (
                None
                if story is None
                else {
                    "partings": [one.sentence for one in story.all_deviations],
                    "judged": story.judged_for,
                    "until": story.until,
                    "why": story.judged[-1].why if story.judged else "",
                }
            )
        return self._story


#: Meaning of each contact, by name.
CONTACTS: Final = {signal.name: signal.description for signal in TABLE.of_kind(Kind.INTERLOCK)}
#: Period in which samples are sorted into the envelope and slow signals are requested.
PUMP: Final = 25 * ms
LOOK: Final = 200 * ms
ASK: Final = 500 * ms
AGAIN: Final = 1 * s  # until another attempt to reach the rig
#: After this time without contact, the state of the rig is unknown.
BLIND: Final = 1.5 * s
#: Maximum number of unsorted blocks of samples; when it is reached, new blocks are dropped.
_WAITING_MAX: Final = 2000
_CONNECT: Final = 5 * s
#: Settings of the valves.
VALVES: Final = (
    *(f"air.{side}_{what}" for side in SIDES for what in ("mode", "reservoir")),
    "air.dpv",
)
#: For limits that judge the reading itself: on which side of the limit it trips. The rig reports it in its steps.
_SIDE: Final = {LimitKind.LOWER: "below", LimitKind.UPPER: "above"}


class KeyReading(msgspec.Struct, frozen=True):
    """A key reading in its display unit; None without a value."""

    name: str
    value: float | None
    age: float | None  #: s since the last sample; None before the first


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """The rig at one moment, as plain data."""

    link: str  #: reason why the rig is unreachable; "" while it sends
    state: str = UNKNOWN
    at_rest: bool = False  #: whether the wiring lists the state as one of rest
    reason: str = ""
    first_out: str = ""  #: the limit that tripped first
    tripped: str = ""  #: the signal of this limit
    program: str = ""
    contacts: dict[str, bool] = {}
    readings: tuple[KeyReading, ...] = ()
    lacking: dict[str, str] = {}  #: unknown measurements, each with the reason
    valves: dict[str, str] = {}  #: `VALVES` as they are in force
    late: int | None = None  #: number of late ticks since the rig started
    latest: float | None = None  #: largest delay (s) of a tick
    lease: bool = False  #: whether a user commands
    strangers: str = ""
    run: dict[str, Any] | None = None  #: the snapshot of the run, if there is one
    pid: int | None = None  #: of the run


class Watch:
    """Watches a rig in its own thread: the present ``status`` of the rig, and the ``envelope`` of past readings."""

    def __init__(self, rig: RigFile, path: Path) -> None:
        self.rig, self.path = rig, path
        self.clock = RealClock()
        self.limits = known_limits(rig)
        self.lacks_stop = _lacks_stop(rig, path)
        self.dimensions = {name: one.value for name, one in dimensions_of(rig, path).known.items()}
        self.shown: tuple[Shown, ...] = shown_signals(self.limits)
        rows = [TABLE.index[one.name] for one in self.shown]
        self._row = np.full(len(TABLE.signals), -1, np.int64)
        self._row[rows] = np.arange(len(rows))
        self._factor, self._zero = np.ones(len(TABLE.signals)), np.zeros(len(TABLE.signals))
        self._factor[rows], self._zero[rows] = zip(
            *((one.factor, one.zero) for one in self.shown), strict=True
        )
        self.row = {one.name: place for place, one in enumerate(self.shown)}
        self.envelope = Envelope(len(rows))
        self.status = Status(link="not connected yet; wait some seconds")
        self.revive: Callable[[], None] = lambda: None  #: called when the rig cannot be reached
        self._waiting: list[tuple[Ints, Ints, Floats]] = []
        self._twin_reader = TwinReader()
        self._contacts: dict[str, bool] = {}
        self._valves: dict[str, str] = {}
        self._listening: Listening | None = None
        self._looks: int | None = None  # when the thread last went round (ns); None before it begins
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch_rig, name="the panel's watch", daemon=True)

    def start(self) -> None:
        """Start to watch."""
        self._thread.start()

    def close(self) -> None:
        """Stop, and disconnect from the rig."""
        self._end.set()
        self._thread.join(_CONNECT)

    def present(self) -> Status:
        """Return the status. If it is outdated, ``link`` of the returned status states this."""
        blind = 0.0 if self._looks is None else (self.clock.now() - self._looks) / NS
        if self.status.link or blind < BLIND:
            return self.status
        silent = f"the panel has not read the rig for {blind:.1f} s; restart the panel"
        return msgspec.structs.replace(self.status, link=silent)

    def act(self, name: str) -> None:
        """Trigger an action of the rig while it has no commander. Raises BenchError if it refuses."""
        self._connected().settings.act(name)

    def go_safe(self) -> None:
        """Order the safe position while the rig has no commander. Raises BenchError if it refuses."""
        self._connected().settings.go_safe(self.clock)

    def glimpses(self, names: Iterable[str]) -> dict[str, float]:
        """Return the last values of signals that the rig sends (SI), NaN without one. No request is sent to the rig."""
        listening = self._listening
        return {name: np.nan if listening is None else listening.readings.glimpse(name) for name in names}

    def samples(self) -> dict[str, Sample]:
        """Return value (SI), age and quality of the shown signals that the rig sends. No request is sent to the rig."""
        listening = self._listening
        if listening is None:
            return {}
        readings = listening.readings
        return {one.name: readings.sample(one.name) for one in self.shown if _is_cyclic(readings, one.name)}

    def write(self, values: Mapping[str, float | str]) -> None:
        """Write settings to the rig while it has no commander. Raises BenchError if it refuses."""
        self._connected().settings.write(values)

    def _connected(self) -> Listening:
        if self._listening is None:
            raise LinkLost(f"the rig cannot be reached: {self.status.link}")
        return self._listening

    # -- in the thread ---------------------------------------------------------------------------------------------

    def _watch_rig(self) -> None:
        while not self._end.is_set():
            try:
                listening = self._listen()
            except (BenchError, RigFileError, ValueError, OSError) as error:
                self.status = self._offline_status(str(error))
                self._revive()
                self._end.wait(AGAIN)
                continue
            listening.receiver.sink = self._queue_samples
            self._listening = listening
            try:
                self._follow(listening)
                self.status = self._offline_status(listening.lost)
            except Exception as error:  # after any error the page would otherwise continue to show old values
                self.status = self._offline_status(str(error) or type(error).__name__)
            finally:
                self._listening = None
                with suppress(BenchError):
                    listening.close()

    def _listen(self) -> Listening:
        if not LINUX:
            raise LinkLost("a rig in real time needs Linux; here the panel shows records only")
        return Listening(open_wiring(self.rig, self.path), self.clock, _CONNECT).open()

    def _revive(self) -> None:
        try:
            self.revive()
        except (BenchError, RigFileError, OSError) as error:
            self.status = self._offline_status(str(error))

    def _follow(self, listening: Listening) -> None:
        """Watch until the link is lost, or `close` is called."""
        looked = asked = -(10**18)
        while not self._end.wait(PUMP) and not listening.lost:
            self._pump()
            now = self._looks = self.clock.now()
            if now - asked >= ASK * NS:
                asked = now
                self._contacts = listening.settings.contacts()
                self._valves = valves(listening)
            if now - looked >= LOOK * NS:
                looked = now
                self.status = self._read_status(listening)

    def _queue_samples(self, times: Ints, rows: Ints, values: "Floats") -> None:
        if len(self._waiting) < _WAITING_MAX:
            self._waiting.append((times, rows, values))

    def _pump(self) -> None:
        """Store new samples in the envelope."""
        waiting, self._waiting = self._waiting, []
        if not waiting:
            return
        times, signals, values = (np.concatenate(column) for column in zip(*waiting, strict=True))
        rows = self._row[signals]
        kept = rows >= 0
        of = signals[kept]
        numbers = ((values[kept] - self._zero[of]) / self._factor[of]).astype(np.float32)
        self.envelope.take(times[kept], rows[kept], numbers)

    def _offline_status(self, link: str) -> Status:
        """Return the status while the rig is unreachable; ``link`` is the reason. It still contains the run."""
        run, pid = self._run()
        return Status(link=link or "the connection is lost", run=run, pid=pid)

    def _run(self) -> tuple[dict[str, Any] | None, int | None]:
        try:
            answer = knock(self.path, {"do": "look"}, BLIND / 2)
        except Deaf:
            return None, self.status.pid  # it is still there, and a stop ends it
        except NoRun:
            return None, None
        run = answer.get("snapshot")
        if run is not None:
            run["twin"] = self._twin_reader.story(run.get("record", ""))
        return run, answer.get("pid")

    def _read_status(self, listening: Listening) -> Status:
        readings, glimpse = listening.readings, listening.readings.glimpse
        state, run = _choice(readings, "rig.state"), self._run()
        late, latest, lease = glimpse("rig.late_ticks"), glimpse("rig.lateness_max"), glimpse("rig.lease")
        sample = readings.sample("rig.state")
        silent = (
            f"no message from the rig for {sample.age:.1f} s; check the rig"
            if sample.quality is not Quality.GOOD
            else ""
        )
        return Status(
            link=silent,
            state=state,
            at_rest=state in listening.wiring.sequences.at_rest,
            reason=_choice(readings, "rig.reason") if state in FAULT_STATES else "",
            first_out=first_out(readings),
            tripped=getattr(TABLE.tripped(readings.glimpse("rig.tripped")), "name", ""),
            program=_choice(readings, "rig.program"),
            contacts=self._contacts,
            readings=tuple(self._reading(readings, one) for one in self.shown if one.key),
            lacking=self._lacking(listening),
            valves=self._valves,
            late=None if np.isnan(late) else round(late),
            latest=None if np.isnan(latest) else latest,
            lease=lease > 0,
            run=run[0],
            pid=run[1],
        )

    def _reading(self, readings: Readings, one: Shown) -> KeyReading:
        sample = readings.sample(one.name) if _is_cyclic(readings, one.name) else None
        if sample is None:
            return KeyReading(one.name, None, None)
        value = None if np.isnan(sample.value) else one.of(sample.value)
        return KeyReading(one.name, value, None if np.isinf(sample.age) else sample.age)

    def _lacking(self, listening: Listening) -> dict[str, str]:
        readings, absent = listening.readings, listening.wiring.absent
        return {
            one.name: absent.get(one.name) or readings.unknown(one.name)
            for one in self.shown
            if one.name in absent or np.isnan(readings.glimpse(one.name))
        }


def _lacks_stop(rig: RigFile, path: Path) -> str:
    """Return why this rig cannot be stopped over its buses; "" if it can."""
    try:
        wiring = wiring_of(rig, path)
    except (BenchError, RigFileError, ValueError) as error:
        return str(error)
    if TO_SAFE not in wiring.absent or wiring.sequences.rest:
        return ""
    return f"the wiring of {rig.name} has no {TO_SAFE} and no sequence to rest; add one of them"


def valves(listening: Listening) -> dict[str, str]:
    """Return the settings of the valves that the rig has."""
    has = [name for name in VALVES if name not in listening.wiring.absent]
    settings = listening.settings.readings(*has) if has else {}
    return {name: _choice_text(name, value) for name, value in settings.items()}


def _is_cyclic(readings: Readings, name: str) -> bool:
    """Whether the rig sends a reading cyclically."""
    return readings.unknown(name) != "read when asked"


def _choice(readings: Readings, name: str) -> str:
    return _choice_text(name, readings.glimpse(name))


def _choice_text(name: str, value: float) -> str:
    choices = TABLE[name].choices
    return choices[round(value)] if 0 <= value < len(choices) else UNKNOWN


def first_out(readings: Readings) -> str:
    """Return the limit that tripped first since the last reset, as text; "" if there is none."""
    tripped = TABLE.tripped(readings.glimpse("rig.tripped"))
    if tripped is None:
        return ""
    kind, steps = readings.glimpse("rig.tripped_kind"), readings.glimpse("rig.tripped_value")
    limit = LimitKind(round(kind)) if kind > 0 else LimitKind.NONE
    name = tripped.name.replace(".", " ").replace("_", " ")
    if limit in _SIDE:
        value = "" if np.isnan(steps) else f", at {tripped.show(steps * tripped.step)}"
        return f"{name} {_SIDE[limit]} its {limit.name.lower()} limit{value}"
    return f"{name} {limit.name.lower()} limit" if limit else f"{name} limit"
