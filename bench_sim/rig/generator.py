"""The function generator of the rig: how a program is started, held and stopped; the tick moves it on."""

from collections.abc import Mapping
from typing import Any, Final

from bench_protocol.rates import TICK
from bench_protocol.units import s
from bench_protocol.words import AXES, CONTROL_MODES, Program
from bench_sim.rig.controls import Target
from bench_sim.rig.setpoints import too_fast

_RETURN_TICKS: Final = round(1 * s / TICK)  # a stopped generator's axis takes one second to come back


class FunctionGenerator:
    """The program in the tick's ``controls``, started with the ``settings`` in force (SI, by name).

    ``lever``: m per rad, of a roll at the vertical actuators.
    """

    def __init__(self, controls: Any, settings: Mapping[str, float], lever: float) -> None:
        self._controls = controls
        self._settings = settings
        self._lever = lever

    @property
    def busy(self) -> bool:
        """Whether a program runs or is held."""
        return self._controls["program"] in (Program.RUN, Program.HOLD)

    def run(self) -> bool:
        """Start the program that is set, or go on with the one that is held; return whether that is possible."""
        c, settings = self._controls, self._settings
        if c["program"] == Program.RUN:
            return False
        if c["program"] == Program.HOLD:
            c["program"] = Program.RUN
            return True
        amplitude = self._amplitude(int(settings["generator.axis"]))
        if amplitude is None or self._too_fast(amplitude):
            return False
        c["axis"], c["wave"] = settings["generator.axis"], settings["generator.wave"]
        c["amplitude"], c["lever"] = amplitude, self._lever
        c["frequency"], c["cycles"] = settings["generator.frequency"], settings["generator.cycles"]
        c["phase"] = 0.0
        c["program"] = Program.RUN
        return True

    def hold(self) -> bool:
        """Stay where the program is; return whether one ran."""
        if self._controls["program"] != Program.RUN:
            return False
        self._controls["program"] = Program.HOLD
        return True

    def stop(self) -> bool:
        """End the program and let the axis come back softly; return whether there was one."""
        if not self.busy:
            return False
        self._absorb_offset()
        self._controls["program"] = Program.STOPPED
        self._controls["slew"][:] = _RETURN_TICKS
        return True

    def freeze(self) -> None:
        """End the program where it is: the set-points take over its offset."""
        c = self._controls
        self._absorb_offset()
        c["program"] = Program.STOPPED if c["program"] != Program.IDLE else Program.IDLE

    def clear(self) -> None:
        """Have no program, as after power on; the set-points keep what the last one added to them."""
        if self._controls["program"] != Program.IDLE:
            self.freeze()
            self._controls["program"] = Program.IDLE

    def forget(self) -> None:
        """Forget how far the last program has come, which is over."""
        self._controls["phase"] = 0.0

    @property
    def moves_actuators(self) -> bool:
        """Whether the program is one of the actuators, and not of the platform."""
        return int(self._controls["axis"]) <= AXES.index("lateral")

    def _amplitude(self, axis: int) -> float | None:
        """Return the amplitude for ``axis`` in its present control mode; None if it cannot move so."""
        settings, name = self._settings, AXES[axis]
        if name == "platform_roll":
            return settings["generator.roll_amplitude"]
        if name.startswith("platform"):
            return settings["generator.amplitude"]
        actuator = Target.LATERAL if name == "lateral" else Target.VERTICAL_LEFT
        mode = CONTROL_MODES[int(self._controls["control"][actuator])]
        if mode == "displacement":
            return settings["generator.roll_amplitude" if name == "roll" else "generator.amplitude"]
        if mode == "force" and name != "roll":
            return settings["generator.force_amplitude"]
        return None

    def _too_fast(self, amplitude: float) -> bool:
        """Tell whether what the staged axis moves could not follow its wave."""
        settings = self._settings
        name = AXES[int(settings["generator.axis"])]
        target = Target.VERTICAL_LEFT if name in ("vertical", "roll") else Target[name.upper()]
        mode = CONTROL_MODES.index("displacement")
        if target <= Target.LATERAL:
            mode = int(self._controls["control"][target])
        height = amplitude * self._lever if name == "roll" else amplitude
        return too_fast(
            target, mode, int(settings["generator.wave"]), height, settings["generator.frequency"]
        )

    def _absorb_offset(self) -> None:
        c = self._controls
        c["setpoint"] += c["offset"]
        c["offset"] = 0.0
        c["phase"] = 0.0
