"""Feeding of the rig's watchdog, so that a commander that cannot write to the PLC does not continue for long."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench_protocol.clock import Clock, Task
from bench_protocol.units import NS, ms, s
from drivers.errors import BenchError

if TYPE_CHECKING:
    from drivers.wiring.astb.modbus import AstbRegisters

#: The rig holds the bench after this time without a write.
WATCHDOG: Final = 1 * s
#: Two late feedings are tolerated.
_PERIOD: Final = round(400 * ms * NS)


class WatchdogFeeder:
    """Arms the rig's watchdog and rewrites its register, in its own task, from ``start`` to ``stop``.

    When that fails, ``failure`` keeps the reason and the feeding ends. The watchdog then trips.
    """

    def __init__(self, registers: AstbRegisters) -> None:
        self._registers = registers
        self._task: Task | None = None
        self.failure: BenchError | None = None

    def start(self, clock: Clock) -> None:
        """Arm the watchdog, and start to feed it."""
        self.failure = None
        self._registers.watch(WATCHDOG)
        self._task = clock.every(_PERIOD, lambda: self._registers.between_requests(self._feed))

    def stop(self) -> None:
        """Stop feeding it."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    def _feed(self) -> None:
        if self.failure is not None or self._task is None:
            return
        try:
            self._registers.watch(WATCHDOG)
        except BenchError as failure:
            self.failure = failure
