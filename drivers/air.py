"""The valves of both springs: fill, vent, level and hold, and the connections between the chambers."""

from __future__ import annotations

import math
from typing import Final

from bench_protocol.units import bar, mbar, minutes, s
from bench_protocol.words import SIDES
from drivers.declarations import ChoiceSetting, Device, Setting
from drivers.errors import BenchTimeout, Misuse

#: The rig's controller and the reading use two transducers, whose zeros may differ by tens of mbar.
PRESSURE_TOLERANCE: Final = 60 * mbar
#: A smaller decrease of a pressure does not count, because it may be noise.
PRESSURE_FALLS: Final = 5 * mbar
#: Time without a decrease after which a pressure is regarded as constant.
STUCK: Final = 20 * s


class Air(Device):
    """The valves of both springs: ``bench.air``. Pressures are gauge."""

    __slots__ = ()
    left_mode = ChoiceSetting()  #: "hold" | "level" | "fill" | "vent"
    left_target = Setting()  #: Pa gauge
    left_reservoir = ChoiceSetting()  #: "off" | "on"
    right_mode = ChoiceSetting()
    right_target = Setting()
    right_reservoir = ChoiceSetting()
    dpv = ChoiceSetting()  #: "off" | "on"

    def fill(
        self,
        to: float | None = None,
        *,
        left: float | None = None,
        right: float | None = None,
        within: float = 2 * minutes,
        tolerance: float = PRESSURE_TOLERANCE,
    ) -> None:
        """Fill the springs to a pressure (Pa gauge) and wait until their pressure is not more than ``tolerance`` (Pa)
        below it.

        ``to`` is for both springs, ``left`` and ``right`` are for one spring each. A spring without a pressure keeps
        its valve positions. The rig continues filling until the next order. Air reaches a bellows only through its
        auxiliary chamber. Raises Misuse if this chamber is shut off, and BenchTimeout after ``within`` s.
        """
        targets = self._targets("fill", to, left, right)
        self._order("fill", targets)
        what = " and ".join(f"{side} filled to {target / bar:g} bar" for side, target in targets.items())
        self._link.wait_for(
            lambda: all(self._pressure(side) >= target - tolerance for side, target in targets.items()),
            within=within,
            what=what,
        )

    def vent(
        self,
        to: float = 0.0,
        *,
        left: float | None = None,
        right: float | None = None,
        within: float = 2 * minutes,
        tolerance: float = PRESSURE_TOLERANCE,
    ) -> None:
        """Vent the springs to a pressure (Pa gauge) and wait until their pressure is not more than ``tolerance`` (Pa)
        above it.

        ``to`` is for both springs. With ``left`` or ``right``, only the springs with a given pressure are vented. Air
        leaves a bellows only through its auxiliary chamber. Raises Misuse if this chamber is shut off, and BenchTimeout
        after ``within`` s. A spring also counts as vented if its bellows pressure stays constant and its auxiliary
        chamber has reached the target. The bellows transducer then has a zero error.
        """
        targets = self._targets("vent", to if left is None and right is None else None, left, right)
        self._order("vent", targets)
        what = " and ".join(f"{side} vented to {target / bar:g} bar" for side, target in targets.items())
        lowest, fell = dict.fromkeys(targets, math.inf), dict.fromkeys(targets, self._link.now)

        def vented() -> bool:
            for side in targets:
                if (pressure := self._pressure(side)) < lowest[side] - PRESSURE_FALLS:
                    lowest[side], fell[side] = pressure, self._link.now
            return all(
                self._pressure(side) <= target + tolerance
                or (
                    self._link.now - fell[side] > STUCK
                    and self._auxiliary_pressure(side) <= target + tolerance
                )
                for side, target in targets.items()
            )

        try:
            self._link.wait_for(vented, within=within, what=what)
        except BenchTimeout as late:
            stuck = [
                f"; {side}.bellows_pressure has not fallen for {self._link.now - since:.0f} s; "
                "check the zero of its transducer and whether a valve lets air in"
                for side, since in fell.items()
                if lowest[side] > targets[side] + tolerance and self._link.now - since > STUCK
            ]
            raise BenchTimeout(f"{late}{''.join(stuck)}") from None

    def level(self) -> None:
        """Connect both springs to their leveling valves."""
        self._link.settings.write({f"air.{side}_mode": "level" for side in SIDES})

    def hold(self) -> None:
        """Close all valves of both springs."""
        self._link.settings.write({f"air.{side}_mode": "hold" for side in SIDES})

    def isolate_dpv(self) -> None:
        """Disconnect the differential pressure valve between the sides."""
        self._link.settings.write({"air.dpv": "off"})

    def connect_dpv(self) -> None:
        """Connect the differential pressure valve between the sides."""
        self._link.settings.write({"air.dpv": "on"})

    def isolate_reservoirs(self) -> None:
        """Shut both bellows off from their auxiliary chambers."""
        self._link.settings.write({f"air.{side}_reservoir": "off" for side in SIDES})

    def connect_reservoirs(self) -> None:
        """Join both bellows with their auxiliary chambers through the orifices."""
        self._link.settings.write({f"air.{side}_reservoir": "on" for side in SIDES})

    def _targets(
        self, verb: str, to: float | None, left: float | None, right: float | None
    ) -> dict[str, float]:
        if to is not None and not (left is None and right is None):
            raise Misuse(f"air.{verb}: give one pressure for both sides or one per side, not both")
        given = {"left": to if to is not None else left, "right": to if to is not None else right}
        targets = {side: target for side, target in given.items() if target is not None}
        if not targets:
            raise Misuse(f"air.{verb}: the pressure is missing; add it, such as to=5 * bar")
        settings = self._link.settings.in_force()
        for side in targets:
            if not settings.get(f"air.{side}_reservoir", True):
                raise Misuse(
                    f"air.{verb}: the {side} bellows is shut off from its auxiliary chamber, so its "
                    "pressure would not change; call air.connect_reservoirs() first"
                )
        return targets

    def _order(self, mode: str, targets: dict[str, float]) -> None:
        settings: dict[str, float | str] = {}
        for side, target in targets.items():
            settings[f"air.{side}_mode"], settings[f"air.{side}_target"] = mode, target
        self._link.settings.write(settings)

    def _pressure(self, side: str) -> float:
        return self._link.readings.value(f"{side}.bellows_pressure")

    def _auxiliary_pressure(self, side: str) -> float:
        """Return the pressure in the auxiliary chamber of a spring (Pa gauge); infinite without a transducer."""
        name = f"{side}.auxiliary_pressure"
        return self._link.readings.value(name) if self._link.has(name) else math.inf
