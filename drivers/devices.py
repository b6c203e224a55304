"""The devices of the bench: every signal of the table in one declarative line, and the verbs of a test engineer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

from bench_protocol.table import SIDES
from bench_protocol.units import bar, kN, mbar, minutes, mm, mrad, ms, s
from drivers.errors import Misuse, RigFault
from drivers.reading import (
    Action,
    Bit,
    ChoiceReading,
    ChoiceSetting,
    Contact,
    Device,
    Reading,
    Setpoint,
    Setting,
)

if TYPE_CHECKING:
    from drivers.bench import Bench

Mode = Literal["off", "force", "displacement"]
Axis = Literal["vertical", "roll", "lateral", "platform_vertical", "platform_lateral", "platform_roll"]
Wave = Literal["sine", "unilateral_cosine", "triangle"]

#: What "there" means while one noisy sample is compared with its target.
FORCE_TOLERANCE: Final = 0.5 * kN
DISPLACEMENT_TOLERANCE: Final = 1 * mm
ANGLE_TOLERANCE: Final = 1 * mrad
#: The rig's controller and the reading are two transducers: their zeros may differ by tens of mbar.
PRESSURE_TOLERANCE: Final = 60 * mbar
#: How long set-points are averaged and streamed before a control mode changes: several beats, no visible pause.
AVERAGE_OVER: Final = 200 * ms
STREAM_BEATS: Final = 3
#: What every move may take longer than its ramp.
MARGIN: Final = 10 * s


class Spring(Device):
    """One air spring with its auxiliary chamber: ``bench.left``, ``bench.right``."""

    __slots__ = ()
    height = Reading()  #: m over design height, up positive
    bellows_pressure = Reading()  #: Pa gauge
    auxiliary_pressure = Reading()  #: Pa gauge
    bellows_temperature = Reading()  #: K
    auxiliary_temperature = Reading()  #: K


class VerticalActuator(Device):
    """One vertical actuator: ``bench.vertical_left``, ``bench.vertical_right``; force positive downward."""

    __slots__ = ()
    force = Reading()  #: N
    displacement = Reading()  #: m
    force_setpoint = Setpoint()  #: N
    displacement_setpoint = Setpoint()  #: m


class ControlMode(ChoiceSetting):
    """The control mode of an axis. Assigning changes it without a bump: the set-points are first what is measured."""

    def set(self, bench: Bench, name: str, value: str) -> None:
        axis = name.partition(".")[0]
        actuators = ("vertical_left", "vertical_right") if axis == "vertical" else (axis,)
        bench.settings.number(name, value)
        if value != "off":
            bench.take_over([f"{actuator}.{value}" for actuator in actuators])
        bench.settings.write({name: value})
        bench.wait_beats(STREAM_BEATS)


class Vertical(Device):
    """Both vertical actuators together: ``bench.vertical``."""

    __slots__ = ()
    control = ControlMode()  #: "off" | "force" | "displacement"

    def preload(
        self,
        left: float,
        right: float,
        *,
        rate: float = 10 * kN / s,
        within: float = 2 * minutes,
        tolerance: float = FORCE_TOLERANCE,
    ) -> None:
        """Press with ``left`` and ``right`` (N, downward): force control, ramps of ``rate`` (N/s).

        BenchTimeout if the forces are not within ``tolerance`` after ``within`` s.
        """
        _mode(self, "force")
        targets = {"vertical_left.force": left, "vertical_right.force": right}
        _move(self._bench, targets, rate, within, dict.fromkeys(targets, tolerance))

    def move_to(
        self,
        left: float,
        right: float,
        *,
        rate: float = 10 * mm / s,
        within: float | None = None,
        tolerance: float = DISPLACEMENT_TOLERANCE,
    ) -> None:
        """Move the two sides to ``left`` and ``right`` (m) with ``rate`` (m/s) in displacement control."""
        _mode(self, "displacement")
        targets = {"vertical_left.displacement": left, "vertical_right.displacement": right}
        _move(self._bench, targets, rate, within, dict.fromkeys(targets, tolerance))

    def hold_position(self) -> None:
        """Stay where the actuators are: displacement control at the present displacements."""
        self.control = "displacement"


class Lateral(Device):
    """The lateral actuator and what stands in its direction: ``bench.lateral``; force and displacement to the left."""

    __slots__ = ()
    force = Reading()  #: N
    displacement = Reading()  #: m
    acceleration = Reading()  #: m/s² at the centre of the bolster
    force_setpoint = Setpoint()  #: N
    displacement_setpoint = Setpoint()  #: m
    control = ControlMode()  #: "off" | "force" | "displacement"

    def move_to(
        self,
        displacement: float,
        rate: float = 10 * mm / s,
        *,
        within: float | None = None,
        tolerance: float = DISPLACEMENT_TOLERANCE,
    ) -> None:
        """Move to ``displacement`` (m) with ``rate`` (m/s) in displacement control, until it is measured."""
        _mode(self, "displacement")
        name = "lateral.displacement"
        _move(self._bench, {name: displacement}, rate, within, {name: tolerance})

    def push(
        self,
        force: float,
        rate: float = 2 * kN / s,
        *,
        within: float | None = None,
        tolerance: float = FORCE_TOLERANCE,
    ) -> None:
        """Push with ``force`` (N) reached with ``rate`` (N/s) in force control, until it is measured."""
        _mode(self, "force")
        _move(self._bench, {"lateral.force": force}, rate, within, {"lateral.force": tolerance})

    def hold_position(self) -> None:
        """Stay where the actuator is: displacement control at the present displacement."""
        self.control = "displacement"


class Platform(Device):
    """The vibration platform: ``bench.platform``; up, left, left side up."""

    __slots__ = ()
    vertical = Reading()  #: m
    lateral = Reading()  #: m
    roll = Reading()  #: rad
    vertical_setpoint = Setpoint()  #: m
    lateral_setpoint = Setpoint()  #: m
    roll_setpoint = Setpoint()  #: rad

    def move_to(
        self,
        vertical: float | None = None,
        lateral: float | None = None,
        roll: float | None = None,
        *,
        rate: float = 10 * mm / s,
        roll_rate: float = 10 * mrad / s,
        within: float | None = None,
    ) -> None:
        """Move the named axes (m, m, rad), the others stay, with ``rate`` (m/s) and ``roll_rate`` (rad/s)."""
        straight = {"platform.vertical": vertical, "platform.lateral": lateral}
        lengths = {name: to for name, to in straight.items() if to is not None}
        angles = {"platform.roll": roll} if roll is not None else {}
        tolerance = {
            name: ANGLE_TOLERANCE if name in angles else DISPLACEMENT_TOLERANCE for name in lengths | angles
        }
        longest = max(_start(self._bench, lengths, rate), _start(self._bench, angles, roll_rate))
        _arrive(self._bench, lengths | angles, longest + MARGIN if within is None else within, tolerance)


class LoadCells(Device):
    """The six cells under the platform: ``bench.load_cell[1]`` to ``[6]`` (N); 1 to 4 vertical, 5 and 6 lateral."""

    __slots__ = ()
    cell_1 = Reading("1")
    cell_2 = Reading("2")
    cell_3 = Reading("3")
    cell_4 = Reading("4")
    cell_5 = Reading("5")
    cell_6 = Reading("6")

    def __getitem__(self, cell: int) -> float:
        if cell not in range(1, 7):
            raise Misuse(f"load_cell[{cell}] does not exist; the cells are 1 to 6")
        return self._bench.readings.value(f"{self._name}.{cell}")


class Supply(Device):
    """The air supply: ``bench.supply``."""

    __slots__ = ()
    pressure = Reading()  #: Pa gauge


class RigStatus(Device):
    """What the rig says of itself, and how it is set up: ``bench.rig``."""

    __slots__ = ()
    nominal_preload = Setting()  #: N per spring at zero height; to be set without load
    orifice_diameter = Setting()  #: m, plates of both sides; to be changed disengaged and without pressure
    pipe = ChoiceSetting()  #: "off" | "on": connecting pipes; to be changed like the plates
    state = ChoiceReading()
    program = ChoiceReading()
    reason = ChoiceReading()
    tripped = Reading()
    status_code = Reading()
    lease = Reading()
    generator_cycle = Reading()
    tick = Reading()
    late_ticks = Reading()
    lateness_max = Reading()  #: s
    rejected_commands = Reading()
    map_hash = Reading()
    lateness_50us = Reading()
    lateness_100us = Reading()
    lateness_250us = Reading()
    lateness_500us = Reading()
    lateness_1ms = Reading()
    lateness_more = Reading()


class Emergency(Device):
    """The last CANopen emergency of the rig: ``bench.emergency``; NaN before the first."""

    __slots__ = ()
    code = Reading()
    register = Reading()
    reason = Reading()


class Control(Device):
    """The bits of the Control message: ``bench.control``; ``bench.arm()`` and ``disarm()`` set them in order."""

    __slots__ = ()
    enable = Bit()  #: D
    hold = Bit()  #: H
    active = Bit()  #: M
    reset = Bit()  #: R


class Actions(Device):
    """The coils: ``bench.action.program_stop()``."""

    __slots__ = ()
    apply = Action()
    reset = Action()
    power_on = Action()
    power_off = Action()
    air_low = Action()
    air_high = Action()
    disable = Action()
    program_run = Action()
    program_hold = Action()
    program_stop = Action()


class Interlocks(Device):
    """The contacts, read when asked: ``bench.interlock.estop``."""

    __slots__ = ()
    estop = Contact()
    pneumatic = Contact()
    program = Contact()
    command = Contact()
    limits = Contact()
    fault = Contact()
    staged = Contact()


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
        """Fill both springs ``to`` a pressure (Pa gauge), or ``left`` and ``right``; wait until it is there.

        A side without a target keeps its valves as they are. The rig stays in filling until the next order. Air
        reaches a bellows only through its auxiliary chamber: Misuse where that is isolated.
        """
        targets = self._targets("fill", to, left, right)
        self._order("fill", targets)
        what = " and ".join(f"{side} filled to {target / bar:g} bar" for side, target in targets.items())
        self._bench.wait_for(
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
        """Let air out of both springs down ``to`` a pressure (Pa gauge), or one side; wait until it is there.

        Air leaves a bellows only through its auxiliary chamber: Misuse where that is isolated.
        """
        targets = self._targets("vent", to if left is None and right is None else None, left, right)
        self._order("vent", targets)
        what = " and ".join(f"{side} vented to {target / bar:g} bar" for side, target in targets.items())
        self._bench.wait_for(
            lambda: all(self._pressure(side) <= target + tolerance for side, target in targets.items()),
            within=within,
            what=what,
        )

    def level(self) -> None:
        """Hand both springs to their leveling valves."""
        self._bench.settings.write({f"air.{side}_mode": "level" for side in SIDES})

    def hold(self) -> None:
        """Shut all valves of both springs."""
        self._bench.settings.write({f"air.{side}_mode": "hold" for side in SIDES})

    def isolate_dpv(self) -> None:
        """Take the differential pressure valve between the sides out of the circuit."""
        self._bench.settings.write({"air.dpv": "off"})

    def connect_dpv(self) -> None:
        """Put the differential pressure valve between the sides into the circuit."""
        self._bench.settings.write({"air.dpv": "on"})

    def isolate_reservoirs(self) -> None:
        """Shut both bellows off from their auxiliary chambers."""
        self._bench.settings.write({f"air.{side}_reservoir": "off" for side in SIDES})

    def connect_reservoirs(self) -> None:
        """Join both bellows with their auxiliary chambers through the orifices."""
        self._bench.settings.write({f"air.{side}_reservoir": "on" for side in SIDES})

    def _targets(
        self, verb: str, to: float | None, left: float | None, right: float | None
    ) -> dict[str, float]:
        if to is not None and not (left is None and right is None):
            raise Misuse(f"air.{verb}: give one pressure for both sides or one per side, not both")
        wanted = {"left": to if to is not None else left, "right": to if to is not None else right}
        targets = {side: target for side, target in wanted.items() if target is not None}
        if not targets:
            raise Misuse(f"air.{verb}: no pressure was given; say to=5 * bar")
        settings = self._bench.settings.in_force()
        for side in targets:
            if not settings[f"air.{side}_reservoir"]:
                raise Misuse(
                    f"air.{verb}: the {side} bellows is shut off from its auxiliary chamber, through which all its air "
                    "goes, and would keep its pressure; air.connect_reservoirs() first"
                )
        return targets

    def _order(self, mode: str, targets: dict[str, float]) -> None:
        settings: dict[str, float | str] = {}
        for side, target in targets.items():
            settings[f"air.{side}_mode"], settings[f"air.{side}_target"] = mode, target
        self._bench.settings.write(settings)

    def _pressure(self, side: str) -> float:
        return self._bench.readings.value(f"{side}.bellows_pressure")


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
        axis: Axis,
        wave: Wave = "sine",
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
        axis: Axis,
        wave: Wave = "sine",
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
        self._bench.settings.write({f"generator.{name}": value for name, value in settings.items()})
        self._bench.settings.act("action.program_run")
        # Frames on their way still tell of the program before: only after two beats do they speak of this one.
        self._bench.wait_beats(STREAM_BEATS)

    def wait_done(self, within: float) -> None:
        """Wait until the program has ended by itself; RigFault if it ended before its last cycle."""
        bench = self._bench
        bench.wait_for(
            lambda: bench.rig.program in ("IDLE", "STOPPED"),
            within=within,
            what="end of the generator's program",
        )
        cycles, done = self.cycles, bench.rig.generator_cycle
        if not done >= cycles:
            raise RigFault(
                f"the generator's program ended after {done:g} of {cycles:g} cycles: {bench.describe()}"
            )

    def hold(self) -> None:
        """Freeze the wave where it is; :meth:`resume` goes on."""
        self._bench.settings.act("action.program_hold")

    def resume(self) -> None:
        """Go on after :meth:`hold`."""
        self._bench.settings.act("action.program_run")

    def stop(self, within: float = 5 * s) -> None:
        """End the program, if one runs, and wait until it has."""
        bench = self._bench
        if bench.rig.program not in ("RUN", "HOLD"):
            return
        bench.settings.act("action.program_stop")
        bench.wait_for(
            lambda: bench.rig.program in ("IDLE", "STOPPED"), within=within, what="stop of the generator"
        )

    def _wanted_amplitude(self, axis: str) -> str:
        if axis == "platform_roll":
            return "roll_amplitude"
        if axis.startswith("platform"):
            return "amplitude"
        mode = self._bench.lateral.control if axis == "lateral" else self._bench.vertical.control
        if mode == "off" or (axis == "roll" and mode != "displacement"):
            needed = "displacement" if axis == "roll" else "force or displacement"
            raise Misuse(f"generator on {axis}: the axis is in control mode {mode!r}; it must be in {needed}")
        if mode == "force":
            return "force_amplitude"
        return "roll_amplitude" if axis == "roll" else "amplitude"


def _mode(device: Vertical | Lateral, mode: Mode) -> None:
    if device.control != mode:
        device.control = mode


def _start(bench: Bench, targets: dict[str, float], rate: float) -> float:
    """Start ramps of the set-points behind the readings ``targets``; return how long they take (s)."""
    return bench.commander.ramp_all({f"{name}_setpoint": to for name, to in targets.items()}, rate)


def _move(
    bench: Bench, targets: dict[str, float], rate: float, within: float | None, tolerance: dict[str, float]
) -> None:
    duration = _start(bench, targets, rate)
    _arrive(bench, targets, duration + MARGIN if within is None else within, tolerance)


def _arrive(bench: Bench, targets: dict[str, float], within: float, tolerance: dict[str, float]) -> None:
    """Wait until all ramps are over and what is measured is near its target."""
    read, moving = bench.readings.value, bench.commander.moving
    setpoints = [f"{name}_setpoint" for name in targets]
    bench.wait_for(
        lambda: (
            not moving(*setpoints) and all(abs(read(n) - to) <= tolerance[n] for n, to in targets.items())
        ),
        within=within,
        what=" and ".join(f"{name} at {bench.table[name].show(to)}" for name, to in targets.items()),
    )
