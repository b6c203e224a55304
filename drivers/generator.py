"""The rig's own function generator, as a plan starts, holds and ends it."""

from __future__ import annotations

from typing import Final

from bench_protocol.units import s
from bench_protocol.words import PROGRAM_STATES, GeneratorAxis, GeneratorWave
from drivers.declarations import ChoiceSetting, Device, Setting
from drivers.errors import Misuse, Refused, RigFault
from drivers.link import STREAM_BEATS

#: What a program may take longer than its cycles.
MARGIN: Final = 10 * s


class Generator(Device):
    """The rig's own function generator: ``bench.generator``; its waves ride on the present set-points."""

    __slots__ = ()
    axis = ChoiceSetting()
    wave = ChoiceSetting()
    amplitude = Setting()  #: m, in displacement control
    roll_amplitude = Setting()  #: rad
    force_amplitude = Setting()  #: N, in force control
    frequency = Setting()  #: Hz
    cycles = Setting()

    def run(
        self,
        axis: GeneratorAxis,
        wave: GeneratorWave = "sine",
        *,
        amplitude: float | None = None,
        roll_amplitude: float | None = None,
        force_amplitude: float | None = None,
        frequency: float,
        cycles: int,
        margin: float = MARGIN,
    ) -> None:
        """Move ``axis`` through ``cycles`` whole cycles and wait for the end, ``margin`` s at most beyond its duration.

        Exactly one amplitude: ``amplitude`` (m) of a displacement, ``roll_amplitude`` (rad) of a roll axis,
        ``force_amplitude`` (N) of an axis in force control. Sine and triangle spend their first and last cycle
        fading in and out.
        """
        self.start(
            axis,
            wave,
            amplitude=amplitude,
            roll_amplitude=roll_amplitude,
            force_amplitude=force_amplitude,
            frequency=frequency,
            cycles=cycles,
        )
        self.wait_done(within=cycles / frequency + margin)

    def start(
        self,
        axis: GeneratorAxis,
        wave: GeneratorWave = "sine",
        *,
        amplitude: float | None = None,
        roll_amplitude: float | None = None,
        force_amplitude: float | None = None,
        frequency: float,
        cycles: int,
    ) -> None:
        """Begin what :meth:`run` does and return while it goes on."""
        amplitudes = {
            "amplitude": amplitude,
            "roll_amplitude": roll_amplitude,
            "force_amplitude": force_amplitude,
        }
        given = {name: value for name, value in amplitudes.items() if value is not None}
        wanted = self._wanted_amplitude(axis)
        if list(given) != [wanted]:
            got = ", ".join(given) or "none"
            raise Misuse(
                f"generator on {axis}: it needs {wanted} as the axis is controlled now; given: {got}"
            )
        settings: dict[str, float | str] = {
            "axis": axis,
            "wave": wave,
            "frequency": frequency,
            "cycles": cycles,
        }
        settings.update(given)
        self._link.settings.write({f"generator.{name}": value for name, value in settings.items()})
        self._link.settings.act("action.program_run")
        # Frames on their way still tell of the program before: only after two beats do they speak of this one.
        self._link.wait_beats(STREAM_BEATS, "rig.program")

    def wait_done(self, within: float) -> None:
        """Wait until the program has ended by itself; RigFault if it ended before its last cycle."""
        link = self._link
        link.wait_for(
            lambda: self._program() in ("IDLE", "STOPPED"),
            within=within,
            what="end of the generator's program",
        )
        cycles, done = self.cycles, link.readings.value("rig.generator_cycle")
        if not done >= cycles:
            raise RigFault(
                f"the generator's program ended after {done:g} of {cycles:g} cycles: {link.describe()}"
            )

    def hold(self) -> None:
        """Freeze the wave where it is; :meth:`resume` goes on."""
        self._link.settings.act("action.program_hold")

    def resume(self) -> None:
        """Go on after :meth:`hold`."""
        self._link.settings.act("action.program_run")

    def stop(self, within: float = 5 * s) -> None:
        """End the program, if one runs, and wait until it has."""
        link = self._link
        if self._program() not in ("RUN", "HOLD"):
            return
        try:
            link.settings.act("action.program_stop")
        except Refused:
            told = link.settings.reading("rig.program")  # asked for, where what came by itself may be old
            if PROGRAM_STATES[int(told)] in ("RUN", "HOLD"):
                raise
            return
        link.wait_for(
            lambda: self._program() in ("IDLE", "STOPPED"), within=within, what="stop of the generator"
        )

    def _program(self) -> str:
        return self._link.readings.choice("rig.program")

    def _wanted_amplitude(self, axis: str) -> str:
        if axis == "platform_roll":
            return "roll_amplitude"
        if axis.startswith("platform"):
            return "amplitude"
        mode = self._link.settings.choice("lateral.control" if axis == "lateral" else "vertical.control")
        if mode == "off" or (axis == "roll" and mode != "displacement"):
            needed = "displacement" if axis == "roll" else "force or displacement"
            raise Misuse(f"generator on {axis}: the axis is in control mode {mode!r}; it must be in {needed}")
        if mode == "force":
            return "force_amplitude"
        return "roll_amplitude" if axis == "roll" else "amplitude"
