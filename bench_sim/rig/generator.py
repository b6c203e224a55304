"""The function generator of the rig: start, hold and stop of a program of waves. The tick advances it."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from bench_protocol.words import AXES, CONTROL_MODES, STEEPEST, WAVES, WAVES_AT_ONCE, Program
from bench_sim.rig.car import RETURN_TICKS, Couplings
from bench_sim.rig.controls import TARGETS, Target
from bench_sim.rig.setpoints import too_fast

_DISPLACEMENT: Final = CONTROL_MODES.index("displacement")
#: A wave as it is set: axis, form, amplitudes and so on (SI, by name).
Wave = Mapping[str, float]


class FunctionGenerator:
    """The program in the tick's ``controls``. It uses the active ``settings`` (SI, by name) when it starts.

    A program is either the wave of the settings, or all added waves. Added waves start at the same tick, each after
    its delay, and are held and stopped together. A program can also be the ride of a car, which ``couplings`` connect
    to the bench. ``lever`` is the displacement of the vertical actuators per roll angle, in m per rad.
    """

    def __init__(
        self, controls: Any, settings: Mapping[str, float], lever: float, couplings: Couplings
    ) -> None:
        self._controls = controls
        self._settings = settings
        self._lever = lever
        self._couplings = couplings
        self._added: list[Wave] = []
        #: Whether a wave of the program is one of the actuators, and not all are of the platform.
        self.moves_actuators = False

    @property
    def busy(self) -> bool:
        """Whether a program runs or is held."""
        return self._controls["program"] in (Program.RUN, Program.HOLD)

    def add(self) -> bool:
        """Add the wave that the settings describe to the next program, if possible. Return whether it was added."""
        waves = [*self._added, self._set_wave()]
        if self.busy or len(waves) > WAVES_AT_ONCE or self._amplitudes(waves) is None:
            return False
        self._added = waves
        return True

    def drop(self) -> None:
        """Delete the waves that were added for the next program."""
        self._added = []

    def run(self) -> bool:
        """Start the added waves, or the wave of the settings if none was added, or resume a held program, if possible.
        Return whether the program was started or resumed.
        """
        c = self._controls
        if c["program"] == Program.RUN:
            return False
        if c["program"] == Program.HOLD:
            c["program"] = Program.RUN
            return True
        waves = self._added or [self._set_wave()]
        amplitudes = self._amplitudes(waves)
        if amplitudes is None:
            return False
        c["waves"] = len(waves)
        c["amplitude"][: len(waves)] = amplitudes
        for k, wave in enumerate(waves):
            for name in ("wave", "frequency", "cycles"):
                c[name][k] = wave[f"generator.{name}"]
            c["phase"][k] = -wave["generator.frequency"] * wave["generator.delay"]
        c["program"] = Program.RUN
        lateral = AXES.index("lateral")
        self.moves_actuators = any(wave["generator.axis"] <= lateral for wave in waves)
        self._added = []
        return True

    def ride(self) -> bool:
        """Start the ride of the car that the settings describe, if possible: all actuators must be in displacement
        control. Return whether it was started.
        """
        c = self._controls
        if self.busy or self._added or (c["control"] != _DISPLACEMENT).any():
            return False
        if not self._couplings.begin(c, self._settings):
            return False
        c["program"] = Program.RUN
        self.moves_actuators = True
        return True

    def hold(self) -> bool:
        """Hold the program at its present position. Return whether one was running."""
        if self._controls["program"] != Program.RUN:
            return False
        self._controls["program"] = Program.HOLD
        return True

    def stop(self) -> bool:
        """End the program and return its axes slowly, or discard the added waves. Return whether there were any."""
        if not self.busy:
            some, self._added = bool(self._added), []
            return some
        self._absorb_offset()
        self._controls["program"] = Program.STOPPED
        self._controls["slew"][:] = RETURN_TICKS
        return True

    def freeze(self) -> None:
        """End the program at its present position. Its offsets are added to the set-points."""
        c = self._controls
        self._absorb_offset()
        c["program"] = Program.STOPPED if c["program"] != Program.IDLE else Program.IDLE

    def clear(self) -> None:
        """Remove the program, as after power on. The set-points keep its offsets."""
        self._added = []
        if self._controls["program"] != Program.IDLE:
            self.freeze()
            self._controls["program"] = Program.IDLE

    def forget(self) -> None:
        """Set the progress of the last program to zero."""
        self._controls["phase"] = 0.0

    def _set_wave(self) -> Wave:
        return {name: value for name, value in self._settings.items() if name.startswith("generator.")}

    def _amplitudes(self, waves: Sequence[Wave]) -> Any:
        """Return the amplitudes (SI) of ``waves``, (waves, TARGETS). Return None if a wave is not possible, or if
        they are too fast together.
        """
        heights = [self._height(wave) for wave in waves]
        if any(height is None for height in heights):
            return None
        amplitudes = np.array(heights)
        steep = [STEEPEST[WAVES[int(wave["generator.wave"])]] * wave["generator.frequency"] for wave in waves]
        speeds = (np.array(steep) @ np.abs(amplitudes)).tolist()
        if any(too_fast(target, self._mode(target), speed) for target, speed in enumerate(speeds)):
            return None
        return amplitudes

    def _mode(self, target: int) -> int:
        return int(self._controls["control"][target]) if target <= Target.LATERAL else _DISPLACEMENT

    def _height(self, wave: Wave) -> Any:
        """Return the amplitude of one wave for each set-point in the present control modes. Return None if it is not
        possible.
        """
        name = AXES[int(wave["generator.axis"])]
        targets = {"vertical": (1.0, 1.0), "roll": (1.0, -1.0)}
        first = Target.VERTICAL_LEFT if name in targets else Target[name.upper()]
        mode = CONTROL_MODES[self._mode(first)]
        if mode == "off":
            return None
        if mode == "force":
            size = wave["generator.force_amplitude"]
        elif name.endswith("roll"):
            size = wave["generator.roll_amplitude"] * (self._lever if name == "roll" else 1.0)
        else:
            size = wave["generator.amplitude"]
        found = np.zeros(TARGETS)
        for k, way in enumerate(targets.get(name, (1.0,))):
            found[first + k] = way * size
        return found

    def _absorb_offset(self) -> None:
        c = self._controls
        c["setpoint"] += c["offset"]
        c["offset"] = 0.0
        c["phase"] = 0.0
        c["riding"] = 0
