"""The rig's own function generator: start, hold and end of programs."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Final

from bench_protocol.units import s
from bench_protocol.words import PROGRAM_STATES, GeneratorAxis, GeneratorWave
from drivers.declarations import ChoiceSetting, Device, Setting
from drivers.errors import TRY_AGAIN, Misuse, NotAvailable, Refused, RigFault
from drivers.link import STREAM_CYCLES, Link

#: Time that a program may take in addition to its cycles.
MARGIN: Final = 10 * s
#: States of a program that has ended.
ENDED: Final = ("IDLE", "STOPPED")


@dataclass(frozen=True, slots=True)
class Wave:
    """One wave of a program: whole cycles on one axis, which begin ``delay`` s after the start of the program.

    Exactly one of the three amplitudes (SI) must be given.
    """

    axis: GeneratorAxis
    form: GeneratorWave = "sine"
    amplitude: float | None = None  #: m, in displacement control
    roll_amplitude: float | None = None  #: rad
    force_amplitude: float | None = None  #: N, in force control; of a roll: up on the left, down on the right
    _: KW_ONLY
    frequency: float
    cycles: int
    delay: float = 0.0

    @property
    def end(self) -> float:
        """The end of the wave (s after the program's start)."""
        return self.delay + self.cycles / self.frequency

    @property
    def amplitudes(self) -> dict[str, float]:
        """The given amplitudes, by the name of their setting."""
        names = ("amplitude", "roll_amplitude", "force_amplitude")
        return {name: value for name in names if (value := getattr(self, name)) is not None}


class Generator(Device):
    """The rig's own function generator: ``bench.generator``. Its waves are added to the present set-points."""

    __slots__ = ()
    axis = ChoiceSetting()
    wave = ChoiceSetting()
    amplitude = Setting()  #: m, in displacement control
    roll_amplitude = Setting()  #: rad
    force_amplitude = Setting()  #: N, in force control
    frequency = Setting()  #: Hz
    cycles = Setting()
    delay = Setting()  #: s, from the start of the program to that of the wave

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
        """Move ``axis`` through ``cycles`` whole cycles; wait for the end, at most ``margin`` s beyond the duration.

        Exactly one amplitude: ``amplitude`` (m) of a displacement, ``roll_amplitude`` (rad) of a roll axis,
        ``force_amplitude`` (N) of an axis in force control. ``frequency`` is in Hz. All waves but the unilateral cosine
        fade in over the first cycle and out over the last.
        """
        one = Wave(axis, wave, amplitude, roll_amplitude, force_amplitude, frequency=frequency, cycles=cycles)
        self._start(one)
        self.wait_done(within=one.end + margin)

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
        """Start the motion of :meth:`run` and return at once."""
        self._start(
            Wave(axis, wave, amplitude, roll_amplitude, force_amplitude, frequency=frequency, cycles=cycles)
        )

    def run_together(self, *waves: Wave, margin: float = MARGIN) -> None:
        """Move several axes at once, on one time base, and wait for the end of the last wave, at most ``margin`` s
        beyond its duration.

        Waves of one axis add up. Errors of single waves, and of their sum, are raised before the motion. A stop
        of one wave stops all.
        """
        self.start_together(*waves)
        self.wait_done(within=max(wave.end for wave in waves) + margin)

    def start_together(self, *waves: Wave) -> None:
        """Start the motion of :meth:`run_together` and return at once."""
        if not waves:
            raise Misuse("the program of the generator has no wave; give at least one")
        link = self._link
        if lacking := link.lacks("action.program_add", "generator.delay"):
            raise NotAvailable(lacking)
        added = 0
        try:
            for wave in sorted(waves, key=lambda one: one.end):  # the rig counts the cycles of the last one
                self._set(wave)
                link.settings.act("action.program_add")
                added += 1
        except BaseException:
            if added:
                link.settings.act("action.program_stop")
            raise
        self._start_program()

    def _start(self, wave: Wave) -> None:
        self._set(wave)
        self._start_program()

    def _start_program(self) -> None:
        self._link.settings.act("action.program_run")
        # Frames in transmission still report the previous program: the new one is visible after two set-point cycles.
        self._link.wait_cycles(STREAM_CYCLES, "rig.program")

    def _set(self, wave: Wave) -> None:
        """Write the settings of ``wave``. Raises Misuse if the given amplitude does not suit the control mode of the
        axis.
        """
        amplitude = self._amplitude_name(wave.axis)
        if list(wave.amplitudes) != [amplitude]:
            got = ", ".join(wave.amplitudes) or "none"
            raise Misuse(
                f"generator on {wave.axis}: the given amplitude is {got}, but the present control mode "
                f"of the axis needs {amplitude}; give only that"
            )
        settings: dict[str, float | str] = {
            "axis": wave.axis,
            "wave": wave.form,
            "frequency": wave.frequency,
            "cycles": wave.cycles,
            **wave.amplitudes,
        }
        if wave.delay or self._link.has("generator.delay"):
            settings["delay"] = wave.delay
        self._link.settings.write({f"generator.{name}": value for name, value in settings.items()})

    def wait_done(self, within: float) -> None:
        """Wait until the program has ended by itself, at most ``within`` s.

        Raises RigFault if it ended before its last cycle, and BenchTimeout if it has not ended by then.
        """
        wait_for_the_end(self._link, self.cycles, within)

    def hold(self) -> None:
        """Freeze the wave at its present phase; :meth:`resume` continues it."""
        self._link.settings.act("action.program_hold")

    def resume(self) -> None:
        """Continue after :meth:`hold`."""
        self._link.settings.act("action.program_run")

    def stop(self, within: float = 5 * s) -> None:
        """End the program, if one runs, and wait for its end, at most ``within`` s."""
        link = self._link
        if self._program() not in ("RUN", "HOLD"):
            return
        try:
            link.settings.act("action.program_stop")
        except Refused:
            program = link.settings.reading("rig.program")  # polled, because the latest sample may be old
            if PROGRAM_STATES[int(program)] in ("RUN", "HOLD"):
                raise
            return
        link.wait_for_status("rig.program", ENDED, within, "stop of the generator")

    def _program(self) -> str:
        return self._link.readings.choice("rig.program")

    def _amplitude_name(self, axis: str) -> str:
        if axis == "platform_roll":
            return "roll_amplitude"
        if axis.startswith("platform"):
            return "amplitude"
        mode = self._link.settings.choice("lateral.control" if axis == "lateral" else "vertical.control")
        if mode == "off":
            raise Misuse(
                f"generator on {axis}: the axis has the control mode 'off'; set it to 'force' or "
                "'displacement'"
            )
        if mode == "force":
            return "force_amplitude"
        return "roll_amplitude" if axis == "roll" else "amplitude"


def wait_for_the_end(link: Link, cycles: float, within: float) -> None:
    """Wait until a program of ``cycles`` cycles has ended by itself, at most ``within`` s.

    Raises RigFault if it ended earlier, and BenchTimeout if it has not ended by then.
    """
    link.wait_for_status("rig.program", ENDED, within, "end of the generator's program")
    done = link.readings.value("rig.generator_cycle")
    if not done >= cycles:
        raise RigFault(
            f"the generator's program ended after {done:g} of {cycles:g} cycles: {link.describe()}; "
            f"{TRY_AGAIN}"
        )
