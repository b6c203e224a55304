"""What a bench asks of a wiring, and a wiring of the transports below it.

Devices and plans know signals: names of the table, values in SI. A *wiring* says where each of them comes from and
goes to. A *transport* carries the points of one connection, which are the rig's own: its names, numbers in its units.

    devices ── link ── wiring ── transport ── the rig
              signals, SI      points, the rig's numbers

Times are whole nanoseconds of the bench's clock. Everything that recurs is a task of that clock (``clock.every``), so
that virtual time drives a wiring as real time does.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from bench_protocol.clock import Clock, Task
from bench_protocol.runtime.mutex import Mutex
from bench_protocol.wires import Table
from bench_protocol.words import AirFate
from drivers.errors import BenchError, LinkLost, NotAvailable

if TYPE_CHECKING:
    from drivers.setpoints import Setpoints

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

#: Called with times (ns), table rows and SI values, three arrays of one length in order of arrival, and with the time
#: from which their age counts (ns, of each sample or of all).
OnSamples = Callable[[Ints, Ints, Floats, "Ints | int"], None]
#: Called once, with the reason in words, when a connection is lost.
OnLost = Callable[[str], None]
#: Called with a time (ns) and the points that came at that time.
OnPoints = Callable[[int, Mapping[str, float]], None]


@dataclass(frozen=True, slots=True)
class Order:
    """What is said to a rig at once: set-points, settings and actions of the table, or points of the rig's own."""

    values: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a rig's state machine: from one of the states ``start``, by orders, to one of the states ``end``."""

    start: tuple[str, ...]
    orders: tuple[Order, ...]  #: one after the other, each given time to show
    end: tuple[str, ...]
    prepare: tuple[Order, ...] = ()  #: before the set-points are taken over
    bumpless: bool = False  #: all set-points are first what is measured
    afterwards: tuple[Order, ...] = ()  #: once the end is reached
    within: float | None = (
        None  #: s for the end to be reached, where that is less than the whole way may take
    )


@dataclass(frozen=True, slots=True)
class Sequences:
    """Start-up to ACTIVE, reset of a fault, shut-down from anywhere, step by step. States are those of the table."""

    up: tuple[Step, ...]
    reset: tuple[Step, ...]
    rest: tuple[Order, ...]
    at_rest: tuple[str, ...]  #: states in which a bench is at rest
    air: Mapping[str, AirFate] = field(
        default_factory=dict
    )  #: what becomes of the springs' air by state, as far as it is known


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What a rig does by itself; what it does not, the bench does for it or does without."""

    generator: bool = False  #: has a function generator; else the host streams its waves as set-points
    lease: bool = False  #: knows one commander at a time
    watchdog: bool = False  #: notices that the settings' connection is silent
    identity: bool = False  #: tells which map it speaks
    files: bool = False  #: keeps files, its black box among them
    pace: Mapping[str, float] = field(
        default_factory=dict
    )  #: how fast set-points are followed, by SI unit, per s
    latency: float = 0.0  #: s until what was said shows in what is read, beside the cycles themselves
    notes: Mapping[str, str] = field(default_factory=dict)  #: in words, by capability, for who looks at a rig


@dataclass(frozen=True, slots=True)
class CyclicStream:
    """What an outlet needs to keep the cycle itself."""

    setpoints: (
        Setpoints  #: to be advanced by one cycle, in compiled code that holds the mutex, before it is sent
    )
    mutex: Mutex
    clock: Clock
    start: int  #: ns; cycles are at ``start + k * period``, k = 1, 2, …
    period: int  #: ns
    failed: Callable[[LinkLost], None]  #: to be called once, when nothing can be sent any more


class Refusal(NamedTuple):
    """Set-points that a rig does not take."""

    since: int  #: ns, when the first of an unbroken row was refused
    error: BenchError  #: the last one's


class Remark(NamedTuple):
    """Something that a rig does otherwise than one might think."""

    text: str
    doubtful: bool  #: readings or commands are lost by it


class Stamp(NamedTuple):
    """Whose clock says when a signal came, and how well."""

    clock: str  #: "hardware" of the interface, or of the "system"
    within: float  #: s, half-width of what it may be off by
    shared: str  #: what comes with the same stamp errs by the same time


class Outlet(Protocol):
    """Where set-points go, cycle by cycle."""

    def send(self, values: Floats, time: int) -> None:
        """Send set-points: ``values`` (SI) by table row, NaN where nothing was given yet. LinkLost if it cannot be."""


@runtime_checkable
class CyclicOutlet(Outlet, Protocol):
    """An outlet that can keep the cycle itself, in compiled code that does not wait for the interpreter."""

    def send_cyclic(self, stream: CyclicStream) -> Task | None:
        """Send on every cycle from now on; None if that cannot be, and `send` is to be called on every cycle."""


@runtime_checkable
class LifeSigns(Protocol):
    """A transport that gives signs of life by itself, once somebody commands."""

    def begin(self) -> float:
        """Give signs of life from now on; return after how long (s) a rig has received some, 0 if there are none."""


@runtime_checkable
class Refusing(Protocol):
    """A transport whose rig may refuse set-points that are streamed."""

    @property
    def refusal(self) -> Refusal | None:
        """Since when set-points are refused, and with which words; None while they are taken."""


@runtime_checkable
class Remarking(Protocol):
    """A transport that notices what its rig does otherwise than one might think."""

    def remarks(self) -> list[Remark]:
        """Return what was noticed since it was connected."""


@runtime_checkable
class Stamping(Protocol):
    """A transport that knows by which clock its points are stamped."""

    def stamp(self, name: str) -> Stamp | None:
        """Return whose stamps a point has, once some have come; None where nothing is known of them."""


class Wiring(Protocol):
    """Where each signal of a bench comes from and goes to, and how its rig is led from state to state.

    Nobody asks which wiring it is: what a rig can do beyond the least, its `capabilities` say.
    """

    @property
    def rig(self) -> str:
        """The rig's name, for messages."""

    @property
    def table(self) -> Table: ...

    @property
    def absent(self) -> Mapping[str, str]:
        """Signals that this rig does not have, each with the reason in words."""

    @property
    def freshness(self) -> Ints:
        """For each table row, after how many ns a sample is stale; 0 for what is read when asked, or absent."""

    @property
    def capabilities(self) -> Capabilities: ...

    @property
    def sequences(self) -> Sequences: ...

    @property
    def outlet(self) -> Outlet: ...

    @property
    def given(self) -> Mapping[str, float]:
        """Set-points that the rig gives to its commander, known once open: its token, or none at all."""

    @property
    def played(self) -> Collection[str]:
        """Signals that the host answers for, because the rig has no generator."""

    @property
    def remembered(self) -> Collection[str]:
        """Settings that are taken to be what was last written, for the rig does not tell them."""

    @property
    def failure(self) -> BenchError | None:
        """What went wrong in the background since `open`: the reason why commands no longer count."""

    def open(self, clock: Clock, receive: OnSamples, lost: OnLost, *, within: float) -> None:
        """Connect, become the commander where there is one, and let samples come from now on.

        LinkLost if the rig is silent for ``within`` s, MapMismatch if it speaks otherwise than is written here,
        NotCommander if somebody else has it. What was opened is closed again when this raises.
        """

    def listening(self) -> Wiring:
        """Return the wiring of somebody who only listens to this rig, not yet open.

        Open, it says nothing by itself and is nobody's commander: one who commands the rig notices nothing.
        """

    def close(self) -> None:
        """Let go of the rig; no callback comes after this has returned. Harmless when repeated."""

    def write(self, values: Mapping[str, float]) -> None:
        """Bring settings (SI) to the rig, all or none. Refused if it does not take them."""

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Return settings in force, contacts, or readings that do not come by themselves (SI; NaN: not available)."""

    def act(self, name: str) -> None:
        """Trigger an action of the table. Refused if the rig does not."""

    def say(self, points: Mapping[str, float]) -> None:
        """Write points of the rig's own that no signal stands for, as its `Sequences` names them."""

    @property
    def commanded(self) -> bool:
        """Whether somebody has commanded since it was opened."""

    def begin(self) -> None:
        """Note that somebody commands from now on, and let the rig receive signs of life before the first command."""

    def is_own(self, port: int, token: float) -> bool:
        """Return whether this commander sent what came from a TCP ``port``, 0 for a bus that knows none.

        ``token`` is that of the present holder, NaN while the rig has not told it. Where the capability ``lease`` is
        missing, nobody knows, and it is False.
        """

    def silent(self) -> AbstractContextManager[None]:
        """Say nothing on the settings' connection while the block lasts, and be heard again after it.

        NotAvailable without the capability ``watchdog``.
        """

    def read_file(self, file: int, record: int, count: int) -> list[int]:
        """Return ``count`` 16-bit words of a file of the rig from ``record`` on. Refused if there is no such file.

        NotAvailable without the capability ``files``.
        """

    # -- for who looks at a rig ----------------------------------------------------------------------------------

    def identity(self) -> str:
        """Return in words what the rig was recognized by and, where it tells, who commands it."""

    def source(self, name: str) -> str:
        """Return in words where a signal is on the wires; "" if it is nowhere."""

    def stamp(self, name: str) -> Stamp | None:
        """Return whose stamps a signal has, once some have come; None where nothing is known of them."""

    def remarks(self) -> Mapping[str, Sequence[Remark]]:
        """Return what was noticed of the rig since it was opened, by transport."""


def refuse_absent(wiring: Wiring, *names: str) -> None:
    """NotAvailable if the rig does not have one of the signals ``names``; it says why."""
    for name in names:
        if name in wiring.absent:
            raise NotAvailable(f"{wiring.rig} has no {name}: {wiring.absent[name]}")


class Transport(Protocol):
    """One connection to a rig: numbers from and to named points, in whatever unit the rig has.

    What a point is (a signal of a DBC, a register, a node of OPC UA) is between the transport and its description; to
    the wiring it is a name. All methods may be called from any thread, one after the other or at once. Values that the
    rig marks as not available are NaN. Errors are LinkLost (nobody answers), Refused (the rig says no) and, before
    anything is sent, WiringError.
    """

    @property
    def period(self) -> float:
        """How often points come by themselves (s) at the slowest; 0 if all are read when asked."""

    def require(self, name: str, *, writable: bool = False) -> None:
        """WiringError, before anything is sent, unless there is a point of that name that can be read, or written."""

    def stale(self, name: str) -> float:
        """Return after how long without news (s) a point is stale; 0 if it does not come by itself."""

    def connect(self, clock: Clock, lost: OnLost, *, within: float) -> None:
        """Connect. LinkLost, in words, if nobody answers ``within`` s."""

    def subscribe(self, receive: OnPoints) -> None:
        """Call ``receive(time, points)`` with what comes from now on, in order; only one thread calls at a time."""

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Ask for points now, if possible as one snapshot."""

    def write(self, points: Mapping[str, float]) -> None:
        """Write points once, in as few messages as possible, in the order given; return when the rig has them."""

    def stream(self, points: Mapping[str, float], time: int) -> None:
        """Take the present value of points that are streamed; the transport sends them at the rig's own rate.

        It is called at each cycle of the set-points, also without points: they then go over another transport, and a
        sign of life over this one goes on.
        """

    def alive(self) -> float:
        """Return how long ago anything came (s); infinite before the first."""

    def close(self) -> None:
        """Disconnect; no callback comes after this has returned. Harmless when repeated."""
