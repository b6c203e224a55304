"""Interfaces between the bench and a wiring, and between a wiring and its transports.

Devices and plans use signals: names of the table with values in SI. A *wiring* maps each signal to its source and
target. A *transport* carries the points of one connection. Points have the rig's names, numbers and units.

    devices ── link ── wiring ── transport ── the rig
              signals, SI      points, the rig's numbers

Times are integers in nanoseconds of the bench's clock. Periodic work is a task of that clock (``clock.every``), so that
a wiring runs in virtual time and in real time alike.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, runtime_checkable

from bench_protocol.arrays import Floats, Ints
from bench_protocol.clock import Clock, Task
from bench_protocol.runtime.mutex import Mutex
from bench_protocol.wires import Table
from bench_protocol.words import AirFate
from drivers.errors import BenchError, LinkLost, NotAvailable

if TYPE_CHECKING:
    from drivers.cycle import Cycle
    from drivers.setpoints import Setpoints


#: Called with three arrays of equal length in order of arrival: times (ns), table rows, values (SI). The fourth
#: argument is the time from which the age counts (ns, of each sample or of all).
OnSamples = Callable[[Ints, Ints, Floats, "Ints | int"], None]
#: Called once with the reason, as text, when a connection is lost.
OnLost = Callable[[str], None]
#: Called with a time (ns) and the points received at that time.
OnPoints = Callable[[int, Mapping[str, float]], None]


@dataclass(frozen=True, slots=True)
class Order:
    """Values to write together: set-points, settings and actions of the table, or points of the rig."""

    values: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a rig's state machine, from one of the states ``start`` to one of the states ``end``."""

    start: tuple[str, ...]
    orders: tuple[Order, ...]  #: written one after the other, with time to take effect after each
    end: tuple[str, ...]
    prepare: tuple[Order, ...] = ()  #: written before the set-points are taken over
    bumpless: bool = False  #: first set all set-points to the measured values
    afterwards: tuple[Order, ...] = ()  #: written once an end state is reached
    within: float | None = (
        None  #: time limit (s) to reach the end state, if shorter than the limit of the whole sequence
    )


@dataclass(frozen=True, slots=True)
class Sequences:
    """Steps for start-up to ACTIVE, reset of a fault, and shut-down from any state. States are those of the table."""

    up: tuple[Step, ...]
    reset: tuple[Step, ...]
    rest: tuple[Order, ...]
    at_rest: tuple[str, ...]  #: states in which a bench is at rest
    air: Mapping[str, AirFate] = field(
        default_factory=dict
    )  #: state of the air of the springs, by state of the rig, if known


#: The error for a rig without a known watchdog, to be formatted with its name. A wiring file cannot state a watchdog.
NO_WATCHDOG: Final = (
    "the wiring of {} does not state that the rig detects a silent commander; test its watchdog by hand"
)


@dataclass(frozen=True, slots=True)
class Capabilities:
    """Functions that a rig provides. The bench replaces a missing function or works without it."""

    generator: bool = False  #: has a function generator; without one the host streams waveforms as set-points
    lease: bool = False  #: accepts one commander at a time
    watchdog: bool = False  #: detects that the connection for settings is silent
    identity: bool = False  #: reports which signal map it uses
    files: bool = False  #: stores files, the black box among them
    pace: Mapping[str, float] = field(default_factory=dict)  #: rate limit of set-points, per s, by SI unit
    latency: float = 0.0  #: delay (s) from a command to its effect in the readings, without the cycles
    notes: Mapping[str, str] = field(default_factory=dict)  #: remarks for users as text, by capability


@dataclass(frozen=True, slots=True)
class CyclicStream:
    """The data that an `Outlet` needs to run the cycle itself."""

    setpoints: Setpoints  #: advance by one cycle before sending, in compiled code that holds the mutex
    mutex: Mutex
    clock: Clock
    start: int  #: ns; cycles are at ``start + k * period``, k = 1, 2, …
    period: int  #: ns
    failed: Callable[[LinkLost], None]  #: to be called once, when sending has failed for good


class Refusal(NamedTuple):
    """Rejection of set-points by a rig."""

    since: int  #: ns, start of the present unbroken series of rejections
    error: BenchError  #: the latest error


class Remark(NamedTuple):
    """An unexpected behaviour of a rig."""

    text: str
    doubtful: bool  #: readings or commands are lost because of it


class Stamp(NamedTuple):
    """The clock that stamps a signal, and its uncertainty."""

    clock: str  #: "hardware" of the interface, or of the "system"
    within: float  #: s, half-width of the uncertainty
    shared: str  #: name of the common stamp; all its signals have the same time error


class Outlet(ABC):
    """The receiver of the set-points of each cycle."""

    @abstractmethod
    def send(self, values: Floats, time: int) -> None:
        """Send set-points: ``values`` (SI) by table row, NaN if not set yet. ``time`` is the time of the cycle (ns).
        Raises LinkLost on failure.
        """

    def send_cyclic(self, stream: CyclicStream) -> Task | None:
        """Send on every cycle from now on, in compiled code that does not wait for the interpreter.

        Returns None if the outlet cannot; then call `send` on every cycle.
        """
        return None


@runtime_checkable
class CyclicPort(Protocol):
    """A CAN port of a simulated bus, which sends the frames of every cycle by itself."""

    def send_cyclic(self, cycle: Cycle, stream: CyclicStream) -> Task | None:
        """Send the frames of ``cycle`` at the times of ``stream`` from now on. Returns None if it cannot."""


class Wiring(Protocol):
    """The source and target of each signal of a bench, and the sequences that change the rig's state.

    Callers do not depend on the kind of wiring. Optional functions of the rig are listed in `capabilities`.
    """

    @property
    def rig(self) -> str:
        """The rig's name, for messages."""

    @property
    def table(self) -> Table: ...

    @property
    def absent(self) -> Mapping[str, str]:
        """Signals that this rig does not have, each with the reason as text."""

    @property
    def freshness(self) -> Ints:
        """Age (ns) above which a sample is stale, by table row; 0 for signals that are polled on request or missing."""

    @property
    def capabilities(self) -> Capabilities: ...

    @property
    def sequences(self) -> Sequences: ...

    @property
    def outlet(self) -> Outlet: ...

    @property
    def given(self) -> Mapping[str, float]:
        """Set-points that the rig assigns to its commander (its token), known once the wiring is open. May be empty."""

    @property
    def played(self) -> Collection[str]:
        """Signals that the host simulates because the rig has no generator."""

    @property
    def remembered(self) -> Collection[str]:
        """Settings that the rig does not report. Their value is assumed to be the last one written."""

    @property
    def failure(self) -> BenchError | None:
        """The first error in the background since `open`; commands have no effect after it."""

    def open(self, clock: Clock, receive: OnSamples, lost: OnLost, *, within: float) -> None:
        """Connect, become the commander where the rig has one, and start to receive samples.

        Raises LinkLost if the rig is silent for ``within`` s, MapMismatch if the rig uses another signal map, and
        NotCommander if another client is the commander. Everything is closed again after an error.
        """

    def listening(self) -> Wiring:
        """Return a wiring, not yet open, that only receives from this rig.

        Once open it sends nothing by itself and never becomes the commander, so it does not disturb one.
        """

    def close(self) -> None:
        """Disconnect from the rig. No callback follows after this returns. Repeated calls are harmless."""

    def write(self, values: Mapping[str, float]) -> None:
        """Write settings (SI), all or none. Raises Refused if the rig rejects them."""

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Return active settings, contacts, or readings that are polled on request (SI; NaN: not available)."""

    def act(self, name: str) -> None:
        """Trigger an action of the table. Raises Refused if the rig rejects it."""

    def write_points(self, points: Mapping[str, float]) -> None:
        """Write points of the rig that map to no signal, as named in its `Sequences`."""

    @property
    def commanded(self) -> bool:
        """Whether a command was sent since the wiring was opened."""

    def begin(self) -> None:
        """Register that commands follow, and start the heartbeat before the first command."""

    def is_own(self, port: int, token: float) -> bool:
        """Return whether a frame or request came from this commander.

        ``port`` is its TCP port, 0 for a bus without ports. ``token`` is the token of the present holder, NaN if the
        rig has not reported it yet. The result is False without the capability ``lease``.
        """

    def silent(self) -> AbstractContextManager[None]:
        """Send nothing on the connection for settings inside the block, and resume after it.

        Raises NotAvailable without the capability ``watchdog``.
        """

    def read_file(self, file: int, record: int, count: int) -> list[int]:
        """Return ``count`` 16-bit words of a file of the rig from ``record`` on. Raises Refused if it does not exist.

        Raises NotAvailable without the capability ``files``.
        """

    # -- for displays and reports --------------------------------------------------------------------------------

    def identity(self) -> str:
        """Return as text how the rig was identified and, if it reports that, which client commands it."""

    def source(self, name: str) -> str:
        """Return as text which frame, register or node carries a signal; "" if none does."""

    def stamp(self, name: str) -> Stamp | None:
        """Return the stamp of a signal, known after its first samples; None if it is unknown."""

    def remarks(self) -> Mapping[str, Sequence[Remark]]:
        """Return the remarks on the rig since the wiring was opened, by transport."""


def refuse_absent(wiring: Wiring, *names: str) -> None:
    """Raise NotAvailable with the reason if the rig lacks one of the signals ``names``."""
    for name in names:
        if name in wiring.absent:
            raise NotAvailable(f"{wiring.rig} has no {name}: {wiring.absent[name]}")


class Transport(ABC):
    """One connection to a rig. It reads and writes the numbers of named points, in the units of the rig.

    A point is a signal of a DBC, a register or a node of OPC UA. Only the transport and its description know which; the
    wiring uses the name. All methods may be called from any thread, also at the same time. Values that the rig marks as
    not available are NaN. The errors are LinkLost (no answer), Refused (the rig rejects the request) and, before
    anything is sent, WiringError.
    """

    @property
    @abstractmethod
    def period(self) -> float:
        """The longest period (s) of the points that arrive without request; 0 if all are polled on request."""

    @abstractmethod
    def require(self, name: str, *, writable: bool = False) -> None:
        """Raise WiringError, before anything is sent, unless the point exists and can be read, or written."""

    @abstractmethod
    def stale(self, name: str) -> float:
        """Return the age (s) above which a point is stale; 0 if it is polled on request."""

    @abstractmethod
    def connect(self, clock: Clock, lost: OnLost, *, within: float) -> None:
        """Connect. Raises LinkLost if there is no answer for ``within`` s."""

    @abstractmethod
    def subscribe(self, receive: OnPoints) -> None:
        """Call ``receive(time (ns), points)`` for received points from now on, in order, from one thread at a time."""

    @abstractmethod
    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Poll points now, if possible as one snapshot."""

    @abstractmethod
    def write(self, points: Mapping[str, float]) -> None:
        """Write points once, in the given order, in as few messages as possible. Returns when the rig has them."""

    @abstractmethod
    def stream(self, points: Mapping[str, float], time: int) -> None:
        """Take the present value of streamed points; the transport sends them at the rig's own rate. ``time`` is the
        time of the cycle (ns).

        It is called at each cycle of the set-points. A call without points keeps the heartbeat of this transport
        running while another transport carries the set-points.
        """

    @abstractmethod
    def alive(self) -> float:
        """Return the time (s) since anything was received; infinite before the first reception."""

    @abstractmethod
    def close(self) -> None:
        """Disconnect. No callback follows after this returns. Repeated calls are harmless."""

    # -- defaults, for a rig without the function ----------------------------------------------------------------

    def begin(self) -> float:
        """Start the heartbeat. Returns the time (s) until a rig has received some beats, 0 without a heartbeat."""
        return 0.0

    @property
    def refusal(self) -> Refusal | None:
        """The present rejection of streamed set-points; None while the rig accepts them."""
        return None

    def stamp(self, name: str) -> Stamp | None:
        """Return the stamp of a point, known after its first samples; None if it is unknown."""
        return None

    def remarks(self) -> list[Remark]:
        """Return the remarks on the rig since the connection was opened."""
        return []
