"""Hold and resume of a run: the request, the state of the bench during the hold, and the release.

A plan defines its hold points, between measurements. During a hold the function generator is stopped, ramps have ended,
all valves are shut and set-points are still sent. Afterwards the valves return to their earlier modes.
"""

from __future__ import annotations

from typing import Final

from bench_protocol.units import minutes
from bench_protocol.words import SIDES
from test_plans.asking import Asking, wait_for_somebody

#: Longest hold (s) with pressurised and loaded springs. After it the run ends, and its tear-down unloads the springs.
HOLD_WITHIN: Final = 30 * minutes
_MODES: Final = tuple(f"air.{side}_mode" for side in SIDES)


class HeldTooLong(Exception):
    """Raised if a held run was not released in time."""


class Suspension:
    """The state of holding of one run: what was requested, and whether it is held. Any thread or signal handler may use
    it.
    """

    def __init__(self) -> None:
        # Single assignments, because a signal handler must not wait for a lock.
        self._wanted_by = ""
        self._held_at = ""
        self._stopped_by = ""
        #: Whether the plan can still reach a hold point.
        self.left = True

    @property
    def stopped_by(self) -> str:
        """Name of the source that ended the run; "" if there is none."""
        return self._stopped_by

    def stop(self, by: str) -> None:
        """Store who ends the run. The first caller counts. May be called by a signal handler."""
        self._stopped_by = self._stopped_by or by

    @property
    def wanted_by(self) -> str:
        """Name of the source that requests a hold; "" if there is none."""
        return self._wanted_by

    @property
    def held_at(self) -> str:
        """Hold point at which the run is held now; "" if it is not held."""
        return self._held_at

    def request(self, by: str) -> None:
        """Request a hold at the next hold point of the plan."""
        self._wanted_by = by

    def resume(self) -> None:
        """Release the hold, or cancel the request."""
        self._wanted_by = ""

    def toggle(self, by: str) -> None:
        """Request a hold; if one is requested or active, release it."""
        self._wanted_by = "" if self._wanted_by else by

    def hold(self, run: Asking, where: str, within: float) -> None:
        """Hold the bench until the run is released. After ``within`` s clear the request and raise HeldTooLong."""
        bench = run.bench
        self._held_at = where
        try:
            modes = {name: value for name, value in bench.settings.in_force().items() if name in _MODES}
            bench.commander.freeze()
            if modes:
                bench.air.hold()
            if not wait_for_somebody(
                run, lambda: not self._wanted_by, within, f"permission to continue from {where}"
            ):
                raise HeldTooLong(
                    f"held {where} for {within:g} s, and the run was not resumed; start it again"
                )
            if modes:
                bench.settings.write(modes)
        except BaseException:
            self._wanted_by = ""  # an aborted run is not held at the next hold point
            raise
        finally:
            self._held_at = ""  # a new request in the meantime applies at the next hold point
