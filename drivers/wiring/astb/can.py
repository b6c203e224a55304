"""CAN of our own table: decoded frames become samples, and set-points become the protected frames of each cycle.

Only messages from the rig are decoded, because a bus can return our own commands as an echo.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Collection
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.arrays import Floats, Ints
from bench_protocol.clock import RealClock, Task, hurry
from bench_protocol.frames import Block
from bench_protocol.units import NS, ms
from bench_protocol.wires import Table
from drivers.errors import LinkLost
from drivers.stamps import StampClock
from drivers.wiring.contract import CyclicPort, CyclicStream, OnSamples, Outlet

if TYPE_CHECKING:
    from bench_protocol.clock import Clock
    from drivers.can_port import CanPort
    from drivers.cycle import Cycle
    from drivers.wire import Wire

STALE_AFTER: Final = 100 * ms
STALE_PERIODS: Final = 3
NEVER: Final = 2**62
#: Time for which the stream continues while the interpreter is blocked, and the period at which Python renews it.
AUTONOMY: Final = round(500 * ms * NS)
_GRANT: Final = round(100 * ms * NS)
_PRIORITY: Final = 5  #: above everything that computes, below a rig on the same machine


def stale_limits(table: Table) -> Ints:
    """Return for every table row the age (ns) above which its value is stale; 0 for rows that CAN does not carry. Rows
    sent only on events never become stale, as the last event remains valid.
    """
    limits = np.zeros(len(table.signals), np.int64)
    for message in table.messages:
        age = max(STALE_AFTER, STALE_PERIODS / message.rate) if message.rate else None
        for place in message.fields:
            limits[table.index[place.signal]] = NEVER if age is None else round(age * NS)
    return limits


class AstbListener:
    """Decodes frames of the rig, and calls ``receive`` with the samples.

    ``stamps`` converts the time stamps of the frames to times of ``clock``; None if they use that clock already. With
    ``stamps`` the age of a reading counts from its arrival. ``absent`` are signals that this rig sends in another
    place; values decoded for them are ignored.
    """

    def __init__(
        self,
        table: Table,
        clock: Clock,
        stamps: StampClock | None,
        receive: OnSamples,
        absent: Collection[str] = (),
    ) -> None:
        from bench_protocol.can_codec import Decoder, Samples

        self._samples = Samples
        self._clock, self._stamps, self._receive = clock, stamps, receive
        self._newest = 0  # ns, time of the newest samples
        self._decoder = Decoder(table, from_rig=True)
        self._map_hash_row = table.index["rig.map_hash"]
        self._lock = threading.Lock()
        #: Rows that are valid if the rig's map differs from the ASTB table; None for all.
        self._rows_here: npt.NDArray[np.bool_] | None = None
        if absent:
            self._rows_here = np.ones(len(table.signals), np.bool_)
            self._rows_here[[table.index[name] for name in absent]] = False

    def receive(self, block: Block) -> None:
        """Decode a block of frames in order of arrival, and pass on the samples."""
        with self._lock:
            if self._stamps is not None:
                block = self._stamps.times(block, self._clock)
            samples = self._decoder.decode(block)
        if self._rows_here is not None:
            chosen = self._rows_here[samples.signals]
            samples = self._samples(samples.times[chosen], samples.signals[chosen], samples.values[chosen])
        if samples.times.size:
            times = samples.times
            fresh: Ints | int = times
            if self._stamps is not None:  # the times of a signal must not decrease when the offset improves
                times = np.maximum.accumulate(np.maximum(times, self._newest))
                self._newest, fresh = int(times[-1]), self._clock.now()
            self._receive(times, samples.signals, samples.values, fresh)

    @property
    def map_hash(self) -> float:
        """The map hash that the rig reports; NaN before the first report."""
        return self._decoder.latest.item(self._map_hash_row)

    def tally(self) -> dict[str, int]:
        """Return the counts of frames since the start: accepted, lost, repeated, malformed…"""
        from bench_protocol.can_codec import Tally

        with self._lock:
            return {kind.name.lower(): int(self._decoder.tally[kind]) for kind in Tally}


class AstbOutlet(Outlet):
    """Sends the protected command messages, one block per cycle.

    In real time the stream continues while a computation blocks the interpreter, for ``AUTONOMY`` at most
    (`drivers.cycle`).
    """

    def __init__(self, table: Table, port: CanPort) -> None:
        from bench_protocol.can_codec import Encoder

        self._port = port
        self._encoder = Encoder(table)
        commands = [message.name for message in table.messages if not message.from_rig and message.rate]
        self._rows = self._encoder.rows(commands)

    def set_token(self, token: int) -> None:
        """Set the token of all frames from now on; not to be called while the cycle runs."""
        self._encoder.bind(token)

    def send(self, values: Floats, time: int) -> None:
        """Encode ``values`` (SI, by table row) and send them through the port, with the time stamp ``time`` (ns). Used
        if compiled code cannot send.
        """
        self._port.send(self._encoder.encode(values, self._rows, time))

    def send_cyclic(self, stream: CyclicStream) -> Task | None:
        """Start the cycle in compiled code and return its task; None where this is impossible.

        It needs compiled code, and a simulated bus or, in real time, a socket.
        """
        from drivers import cycle

        if not cycle.COMPILED:
            return None
        state = cycle.Cycle.of(self._encoder, self._rows, stream.setpoints)
        if isinstance(self._port, CyclicPort):
            return self._port.send_cyclic(state, stream)
        wire = self._port.wire
        if wire is None or not isinstance(stream.clock, RealClock):
            return None
        return _PunctualTask(state, wire, stream, stream.clock)


class _PunctualTask:
    """The compiled cycle in its own thread. Python periodically grants further cycles as long as the plan runs."""

    def __init__(self, state: Cycle, wire: Wire, stream: CyclicStream, clock: RealClock) -> None:
        self._counts, self._ahead = state.counts, AUTONOMY // stream.period
        begin = clock.monotonic(stream.start)
        period = clock.monotonic(stream.start + stream.period) - begin

        def run() -> None:
            from drivers.cycle import run_cycles

            hurry(_PRIORITY)
            mutex, wire_mutex = stream.mutex.address, wire.mutex.address
            error = run_cycles(state, mutex, wire.descriptor, wire_mutex, wire.lines, begin, period)
            if error:
                wire.cut()  # an incomplete line may have been sent
                stream.failed(LinkLost(f"frames could not be sent: {os.strerror(error)}"))

        self._grant()
        self._granting = clock.every(_GRANT, self._grant)
        self._thread = threading.Thread(target=run, name="every 20 ms", daemon=True)
        self._thread.start()

    def _grant(self) -> None:
        self._counts["granted"][0] = self._counts["sent"][0] + self._ahead

    def cancel(self) -> None:
        self._counts["stop"][0] = 1
        self._granting.cancel()
        if threading.current_thread() is not self._thread:
            self._thread.join()
