"""Holding a run: who may ask for it, how the bench is kept meanwhile, and how the run goes on.

A plan says where it can be held, between its measurements. There the function generator stands, ramps have ended, all
valves are shut and the set-points go on being sent; afterwards the valves are what they were.
"""

from __future__ import annotations

from typing import Final

from bench_protocol.units import minutes
from bench_protocol.words import SIDES
from test_plans.asking import Asking, wait_for_somebody

#: Longer nobody may keep the springs under air and load; then the run is given up and they are let down.
HOLD_WITHIN: Final = 30 * minutes
_MODES: Final = tuple(f"air.{side}_mode" for side in SIDES)


class HeldTooLong(Exception):
    """Nobody let a held run go on."""


class Suspension:
    """Whether somebody wants a run to be held, and where it is held; from any thread, or a signal's handler."""

    def __init__(self) -> None:
        # Single assignments: a handler of a signal must not wait for a lock.
        self._wanted_by = ""
        self._held_at = ""
        self._stopped_by = ""
        #: Whether the plan may come to a place where it can be held.
        self.left = True

    @property
    def stopped_by(self) -> str:
        """Who ends the run, "" if nobody has said so."""
        return self._stopped_by

    def stop(self, by: str) -> None:
        """Note who ends the run; a signal does it."""
        self._stopped_by = self._stopped_by or by

    @property
    def wanted_by(self) -> str:
        """Who wants the run to be held, "" if nobody does."""
        return self._wanted_by

    @property
    def held_at(self) -> str:
        """Where the run is held now, "" if it is not."""
        return self._held_at

    def request(self, by: str) -> None:
        """Hold the run at the next place where its plan allows it."""
        self._wanted_by = by

    def resume(self) -> None:
        """Let the run go on, or take the request back."""
        self._wanted_by = ""

    def toggle(self, by: str) -> None:
        """Request, or resume."""
        self._wanted_by = "" if self._wanted_by else by

    def hold(self, run: Asking, where: str, within: float) -> None:
        """Keep the bench as it is until the run may go on. HeldTooLong after ``within`` s, and it has been let go."""
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
                raise HeldTooLong(f"held {where} for {within:g} s, and nobody let it continue")
            if modes:
                bench.settings.write(modes)
        except BaseException:
            self._wanted_by = ""  # what is given up is not held at the next place
            raise
        finally:
            self._held_at = ""  # somebody who asks again meanwhile is heard at the next place
