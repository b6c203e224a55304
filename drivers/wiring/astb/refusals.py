"""Reasons why our own rig refuses an action or settings, from its readings, and how to correct them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final

from bench_protocol.signals import Group
from bench_protocol.table import TABLE
from bench_protocol.table_signals import MEASUREMENTS
from bench_protocol.units import bar
from bench_protocol.words import CONTROL_MODES, LIVE_STATES, PROGRAM_STATES, STATES, WAVES_AT_ONCE

#: Gauge pressures below which the actuators may release the bolster, and a flange may be opened.
EMPTY: Final = 0.22 * bar
FLANGE: Final = 0.3 * bar
_CHAMBERS: Final = tuple(signal.name for signal in MEASUREMENTS if signal.group is Group.PRESSURE)
_ENGAGED: Final = ("HOLD", "ACTIVE", "FAULT_HOLD", "FAULT_REACTION")
_PLATES: Final = ("rig.orifice_diameter", "rig.pipe")
_CONTROLS: Final = ("vertical.control", "lateral.control")
#: States in which an action is possible.
_POSSIBLE_IN: Final[Mapping[str, tuple[str, ...]]] = {
    "action.power_on": ("OFF",),
    "action.power_off": ("BOOT", "INIT", "DISABLED", *LIVE_STATES),
    "action.air_low": ("AIR_HIGH",),
    "action.air_high": ("AIR_LOW",),
    "action.disable": (*LIVE_STATES, "FAULT_HOLD"),
    "action.reset": ("DISABLED", "FAULT_HOLD", "FAULT_DISABLED", "ESTOP"),
    "action.program_run": ("ACTIVE",),
    "action.program_add": ("ACTIVE",),
    "action.program_car": ("ACTIVE",),
}
_NEEDS_COMMANDS: Final = {"action.air_high": ("AIR_LOW",), "action.reset": ("DISABLED", "FAULT_HOLD")}
_PROGRAM: Final = {
    "action.program_hold": "no program runs",
    "action.program_stop": "no program runs, is held or is prepared",
}


@dataclass(frozen=True, slots=True)
class RigState:
    """The state of the rig just after a refusal: readings and active settings (SI), and contacts."""

    readings: Mapping[str, float]
    contacts: Mapping[str, bool]

    @property
    def state(self) -> str:
        """The state of the bench by name."""
        return STATES[int(self.readings["rig.state"])]

    @property
    def program(self) -> str:
        """The state of the function generator by name."""
        return PROGRAM_STATES[int(self.readings["rig.program"])]


def action_refusal(name: str, rig: RigState) -> str:
    """Return why the rig refuses the action ``name``, and how to correct it; "" if the readings do not show it."""
    state = rig.state
    possible = _POSSIBLE_IN.get(name, STATES)
    if state not in possible:
        return f"the bench is in {state}; this action is possible in {' or '.join(possible)} only"
    if name == "action.power_on":
        return "the mains are off; switch them on first"
    if name == "action.reset" and state == "ESTOP" and rig.contacts.get("interlock.estop"):
        return "the emergency stop is pressed; release the button first"
    if state in _NEEDS_COMMANDS.get(name, ()) and not rig.contacts.get("interlock.command", True):
        return "the rig receives no valid command frames with D set on CAN; send them first"
    if name in ("action.program_run", "action.program_add"):
        if rig.program == "RUN" or (rig.program == "HOLD" and name == "action.program_add"):
            return "a program runs already; stop it first"
        many = (
            f", or the program would have more than {WAVES_AT_ONCE} waves"
            if name == "action.program_add"
            else ""
        )
        return (
            "an axis cannot make this motion in its present control mode, or the sum of its waves is "
            f"too fast{many}; change the mode, or use a smaller amplitude or frequency"
        )
    if name == "action.program_car":
        if rig.program in ("RUN", "HOLD"):
            return "a program runs already, or is held; stop it first"
        if any(CONTROL_MODES[int(rig.readings[one])] != "displacement" for one in _CONTROLS):
            return (
                "a car needs displacement control; set vertical.control and lateral.control to displacement"
            )
        return (
            "the settings of the car are incomplete (it needs a mass, a radius of gyration, a bump "
            "stop whose travel rises from point to point, and a frequency of the track), its track is "
            "too fast, or waves were added for another program; correct the settings, or discard the waves by "
            "action.program_stop"
        )
    return _PROGRAM.get(name, "")


def settings_refusal(changed: Collection[str], rig: RigState) -> str:
    """Return why the rig refuses to change the settings ``changed``, and how to correct it; "" if unknown."""
    reasons = []
    if rig.program in ("RUN", "HOLD") and any(name in _CONTROLS for name in changed):
        how = "runs" if rig.program == "RUN" else "is held"
        reasons.append(f"a control mode cannot change while a program {how}; stop the program first")
    opened = any(name in _PLATES for name in changed)
    if opened or "rig.nominal_preload" in changed:
        what = "plates and pipes" if opened else "shims"
        if reason := _blocked_change(rig, FLANGE if opened else EMPTY):
            reasons.append(
                f"{what} can be changed only while the springs are empty and no actuator holds the "
                f"bolster: {reason}"
            )
    return "; ".join(reasons)


def _blocked_change(rig: RigState, pressure_max: float) -> str:
    """Return why plates, pipes or shims cannot be changed now.

    ``pressure_max``: gauge pressure (Pa) from which on a change is refused.
    """
    if rig.state in _ENGAGED:
        return f"the bench is in {rig.state}, so the actuators hold the bolster; disarm the bench first"
    measured = {name: rig.readings.get(name, math.nan) for name in _CHAMBERS}
    full = [
        f"{name} is {TABLE[name].show(value)}"
        for name, value in measured.items()
        if value >= min(EMPTY, pressure_max)
    ]
    silent = [
        f"{name} gives no value, which counts as pressure"
        for name, value in measured.items()
        if math.isnan(value)
    ]
    if silent:
        return f"{', '.join(silent)}; repair or replace the transducer first"
    if full:
        return f"{', '.join(full)}; vent both springs first, or disarm the bench, which vents them"
    if rig.state in LIVE_STATES:
        return f"the bench is in {rig.state}, so the actuators hold the bolster; disarm the bench first"
    return "the actuators still set the bolster down; wait some seconds"
