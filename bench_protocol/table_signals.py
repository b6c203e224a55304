"""The signals of the table: every value that crosses the wires of the bench, one row each, with its Modbus address.

Pressures on the wires are gauge; displacements are positive upward and to the left (+y), vertical actuator forces
positive downward (a preload is positive), lateral forces positive to the left. An address never changes; a new row
takes a free one.
"""

from collections.abc import Iterator
from itertools import count
from typing import Final

from bench_protocol.car import STOP_POINTS
from bench_protocol.rates import LATENESS_BINS
from bench_protocol.signals import Group, Kind, Signal
from bench_protocol.units import N, bar, kN, m, mbar, mm, mrad, ms, rad, s, us
from bench_protocol.words import (
    ACTUATORS,
    AIR_MODES,
    AXES,
    CONTROL_MODES,
    LIMIT_KINDS,
    PIPE_LENGTH,
    PLATFORM_AXES,
    PROGRAM_STATES,
    REASONS,
    STATES,
    SWITCH,
    WAVES,
    WAVES_AT_ONCE,
)

COUNT_MAX: Final = float(2**24 - 2)  # largest exact number in 24 bits on CAN and in a float32 register


def _range(group: Group) -> tuple[str, float, float, float]:
    """Return unit, ends and step of a group on the wires."""
    return group.row.unit, *group.row.carried, group.row.step


def _reading(name: str, address: int, group: Group, text: str) -> Signal:
    return Signal(name, Kind.MEASUREMENT, *_range(group), text, address=address, group=group)


_LASER: Final = "Laser: spring height over design height"
_BELLOWS: Final = "Gauge pressure in the bellows"
_AUXILIARY: Final = "Gauge pressure in the auxiliary chamber"
_WARM_BELLOWS: Final = "Gas in the bellows, 1 s lag"
_WARM_AUXILIARY: Final = "Gas in the auxiliary, 1 s lag"
_FORCE: Final = "Force transducer of the actuator"
_PISTON: Final = "Displacement transducer of the actuator"
_UPRIGHT: Final = "vertical cell under the platform"
_ACROSS: Final = "lateral cell under the platform"

#: In the order of the sensors of the measuring chain (`bench_sim.model.layout.Sensor`), and before all other signals:
#: the row of a measurement is the number of its sensor, which is checked where the two meet.
MEASUREMENTS: Final = (
    _reading("left.height", 100, Group.HEIGHT, _LASER),
    _reading("right.height", 106, Group.HEIGHT, _LASER),
    _reading("left.bellows_pressure", 102, Group.PRESSURE, _BELLOWS),
    _reading("right.bellows_pressure", 108, Group.PRESSURE, _BELLOWS),
    _reading("left.auxiliary_pressure", 104, Group.PRESSURE, _AUXILIARY),
    _reading("right.auxiliary_pressure", 110, Group.PRESSURE, _AUXILIARY),
    _reading("supply.pressure", 138, Group.SUPPLY_PRESSURE, "Gauge pressure of the supply"),
    _reading("left.bellows_temperature", 140, Group.TEMPERATURE, _WARM_BELLOWS),
    _reading("right.bellows_temperature", 144, Group.TEMPERATURE, _WARM_BELLOWS),
    _reading("left.auxiliary_temperature", 142, Group.TEMPERATURE, _WARM_AUXILIARY),
    _reading("right.auxiliary_temperature", 146, Group.TEMPERATURE, _WARM_AUXILIARY),
    _reading("vertical_left.force", 112, Group.VERTICAL_FORCE, _FORCE),
    _reading("vertical_right.force", 116, Group.VERTICAL_FORCE, _FORCE),
    _reading("lateral.force", 120, Group.LATERAL_FORCE, _FORCE),
    _reading("vertical_left.displacement", 114, Group.DISPLACEMENT, _PISTON),
    _reading("vertical_right.displacement", 118, Group.DISPLACEMENT, _PISTON),
    _reading("lateral.displacement", 122, Group.DISPLACEMENT, _PISTON),
    _reading("load_cell.1", 124, Group.VERTICAL_LOAD_CELL, f"Load cell 1: {_UPRIGHT}"),
    _reading("load_cell.2", 126, Group.VERTICAL_LOAD_CELL, f"Load cell 2: {_UPRIGHT}"),
    _reading("load_cell.3", 128, Group.VERTICAL_LOAD_CELL, f"Load cell 3: {_UPRIGHT}"),
    _reading("load_cell.4", 130, Group.VERTICAL_LOAD_CELL, f"Load cell 4: {_UPRIGHT}"),
    _reading("load_cell.5", 132, Group.LATERAL_LOAD_CELL, f"Load cell 5: {_ACROSS}"),
    _reading("load_cell.6", 134, Group.LATERAL_LOAD_CELL, f"Load cell 6: {_ACROSS}"),
    _reading(
        "lateral.acceleration",
        136,
        Group.ACCELERATION,
        "Accelerometer across the bolster; its lean reads gravity",
    ),
    _reading("platform.vertical", 148, Group.PLATFORM_DISPLACEMENT, "Vibration platform, up"),
    _reading("platform.lateral", 150, Group.PLATFORM_DISPLACEMENT, "Vibration platform, left"),
    _reading("platform.roll", 152, Group.PLATFORM_ROLL, "Vibration platform, left side up"),
)


def _state(name: str, address: int, choices: tuple[str, ...], text: str) -> Signal:
    return Signal(name, Kind.STATUS, "1", 0, len(choices) - 1, 1, text, choices, address=address)


def _count(name: str, address: int, text: str, high: float = COUNT_MAX) -> Signal:
    return Signal(name, Kind.STATUS, "1", 0, high, 1, text, address=address)


_EMERGENCIES: Final = (
    "CANopen emergency: 0 no error, 0x8130 command lost, 0xFF01 limit, 0xFF02 stop, 0xFF03 tick"
)
STATUS: Final = (
    _state("rig.state", 154, STATES, "State of the bench"),
    _state("rig.program", 156, PROGRAM_STATES, "State of the function generator's program"),
    _state("rig.reason", 158, REASONS, "Why the bench left ACTIVE; the first cause stays until a reset"),
    _count(
        "rig.tripped",
        160,
        "Whose limit tripped first: number of the reading, its discrete input less 99; 0 for none",
        255,
    ),
    _count("rig.status_code", 162, "0 disabled, 1xx idle, 2xx warning, 3xx busy, 4xx error", 499),
    _count("rig.lease", 164, "Token of the commander that holds the bench, 0 if nobody", 65535),
    _count(
        "rig.generator_cycle",
        166,
        "Completed cycles of the function generator, of the wave added last",
        65534,
    ),
    _count("rig.tick", 168, "Ticks since start, modulo 2^24 - 1 (0 follows 16777214)"),
    _count("rig.late_ticks", 170, "Ticks that began more than one period after their deadline", 65534),
    Signal(
        "rig.lateness_max",
        Kind.STATUS,
        "us",
        0,
        65534 * us,
        1 * us,
        "Largest lateness of a tick since start",
        address=172,
    ),
    _count("rig.rejected_commands", 174, "Command frames refused by their end-to-end protection", 65534),
    _count("emergency.code", 176, _EMERGENCIES, 65534),
    _count("emergency.register", 178, "CANopen error register", 254),
    _count("emergency.reason", 180, "Number of the reason, as in rig.reason", 254),
    _count("rig.map_hash", 182, "First 32 bits of the hash of this table", float(2**32 - 1)),
    *(
        _count(one.signal, address, f"Ticks that began {one.text} after their deadline")
        for address, one in zip((184, 186, 188, 190, 192, 194), LATENESS_BINS, strict=True)
    ),
    _count(
        "rig.refused_setpoints", 198, "Frames of set-points refused: one of them was out of its range", 65534
    ),
    _state("rig.tripped_kind", 200, LIMIT_KINDS, "What kind of limit tripped first; stays until a reset"),
    Signal(
        "rig.tripped_value",
        Kind.STATUS,
        "1",
        -32767,
        32767,
        1,
        "What that limit judged: in steps of its reading (of a rate: per second), ms of a timeout, or a count",
        address=202,
    ),
    _count("rig.tripped_tick", 204, "rig.tick when it tripped"),
    _count(
        "rig.holder", 208, "TCP port of the connection that holds the bench, 0 for nobody or unknown", 65535
    ),
    _count("rig.strangers", 210, "Frames and requests refused because they did not come from the holder"),
    _count(
        "rig.stranger", 212, "TCP port that the last of them came from, 0 where the wire does not tell", 65535
    ),
    _count("rig.stranger_identifier", 214, "CAN identifier of the last of them, 0 for Modbus", 65535),
    *(
        Signal(
            f"car.{name}", Kind.STATUS, unit, -span, span, step, f"Car in the loop: {text}", address=address
        )
        for name, address, unit, span, step, text in (
            ("shear", 218, "mm", 300 * mm, 0.01 * mm, "how far it has the springs sheared"),
            ("height", 220, "mm", 300 * mm, 0.01 * mm, "how far it has them lengthened"),
            ("roll", 1100, "mrad", 0.3 * rad, 0.01 * mrad, "its roll against the track, left side up"),
            ("acceleration", 1102, "m/s2", 16.0, 0.002, "lateral acceleration of its floor"),
            ("rising", 1104, "m/s2", 16.0, 0.002, "vertical acceleration"),
            ("bump_stop", 1106, "kN", 200 * kN, 25 * N, "force of its bump stop"),
            ("wind", 1108, "kN", 60 * kN, 8 * N, "force of the wind on it"),
        )
    ),
)


def _setpoint(name: str, unit: str, span: float, step: float, text: str) -> Signal:
    return Signal(name, Kind.SETPOINT, unit, -span, span, step, text)


def _bit(name: str, text: str) -> Signal:
    return Signal(f"control.{name}", Kind.SETPOINT, "1", 0, 1, 1, text, SWITCH)


def _word(name: str, text: str) -> Signal:
    return Signal(name, Kind.SETPOINT, "1", 0, 65535, 1, text)


SETPOINTS: Final = (
    _bit("enable", "D: leave INIT; clearing it disables the bench"),
    _bit("hold", "H: HOLD or higher; clearing it lets the actuators go, once the springs are empty"),
    _bit("active", "M: ACTIVE; clearing it holds the present value"),
    _bit("reset", "R: its rising edge resets a fault and leaves DISABLED"),
    _word(
        "control.token", "What the rig drew for the holder of the lease; without it a frame is a stranger's"
    ),
    _setpoint("vertical_left.force_setpoint", "kN", 200 * kN, 10 * N, "Used in force control"),
    _setpoint("vertical_right.force_setpoint", "kN", 200 * kN, 10 * N, "Used in force control"),
    _setpoint("lateral.force_setpoint", "kN", 60 * kN, 2 * N, "Used in force control"),
    *(
        _setpoint(f"{one}.displacement_setpoint", "mm", 300 * mm, 0.01 * mm, "Used in displacement control")
        for one in ACTUATORS
    ),
    *(
        _setpoint(f"platform.{axis}_setpoint", "mm", 150 * mm, 0.01 * mm, "Vibration platform")
        for axis in PLATFORM_AXES[:2]
    ),
    _setpoint("platform.roll_setpoint", "mrad", 0.3, 0.01 * mrad, "Vibration platform, left up"),
    _setpoint("car.wind_setpoint", "kN", 60 * kN, 2 * N, "Wind on the car in the loop, to the left"),
    _word("lease.nonce", "Any number: by it the asker knows the answer that is meant for it"),
    _word("lease.token", "0 asks for the lease; the holder's token returns it"),
)


def _choice(name: str, address: int, choices: tuple[str, ...], text: str, default: int = 0) -> Signal:
    return Signal(name, Kind.SETTING, "1", 0, len(choices) - 1, 1, text, choices, default, address)


def _number(
    name: str, address: int, unit: str, span: tuple[float, float], step: float, text: str, default: float = 0
) -> Signal:
    return Signal(name, Kind.SETTING, unit, *span, step, text, (), default, address)


def _of_a_car() -> Iterator[Signal]:
    """Yield the settings of a car in the loop: half a car, on one bogie."""
    addresses = count(140, 2)

    def one(name: str, unit: str, most: float, step: float, text: str) -> Signal:
        return _number(f"car.{name}", next(addresses), unit, (0.0, most), step, f"Car in the loop: {text}")

    yield one(
        "mass",
        "kg",
        1e9,
        1.0,
        "mass of its half; one that is too heavy to move shakes the springs by its track",
    )
    yield one("roll_gyration", "m", 10 * m, 1 * mm, "radius of gyration in roll")
    yield one("centre_height", "m", 5 * m, 1 * mm, "centre of gravity above the top plates of the springs")
    yield one("floor_depth", "m", 5 * m, 1 * mm, "floor below the centre of gravity")
    yield one("wind_height", "m", 5 * m, 1 * mm, "where the wind acts above the centre of gravity")
    yield one("damper_rate", "kN*s/m", 500 * kN, 1 * N, "lateral damper")
    yield one("damper_depth", "m", 5 * m, 1 * mm, "lateral damper below the centre of gravity")
    yield one("bump_stop_depth", "m", 5 * m, 1 * mm, "bump stop below the centre of gravity")
    yield one("anti_roll_stiffness", "kN*m/rad", 20_000 * kN, 10 * N, "anti-roll bar")
    for point in range(1, STOP_POINTS + 1):
        yield one(
            f"stop_travel_{point}", "mm", 300 * mm, 0.01 * mm, f"travel of the bump stop, point {point}"
        )
        yield one(f"stop_force_{point}", "kN", 1000 * kN, 1 * N, f"its force there, point {point}")
    yield one("track_frequency", "Hz", 30.0, 1e-4, "waves of the track, unilateral cosines, in a second")
    yield one("track_waves", "1", 10_000, 1, "whole waves of the track; with the last the ride ends")
    yield one("track_lateral", "mm", 100 * mm, 0.01 * mm, "height of a wave to the left")
    yield one("track_vertical", "mm", 100 * mm, 0.01 * mm, "height of a wave upward")
    yield one("track_roll", "mrad", 0.15 * rad, 0.01 * mrad, "height of a wave in roll, left side up")
    yield one(
        "piston_lead", "ms", 200 * ms, 0.01 * ms, "how late the pistons are: so much they are told ahead"
    )
    yield one("platform_lead", "ms", 200 * ms, 0.01 * ms, "how late the platform is")


_CAR: Final = tuple(_of_a_car())
_VALVES: Final = "hold: all valves shut; level: leveling valve; fill: to the target"
_TARGET: Final = "Gauge pressure that fill and vent aim for"
_JOINED: Final = "on: bellows and auxiliary chamber joined by the orifice"
SETTINGS: Final = (
    _choice("air.left_mode", 100, AIR_MODES, _VALVES),
    _number("air.left_target", 102, "bar", (0.0, 9 * bar), 1 * mbar, _TARGET),
    _choice("air.left_reservoir", 104, SWITCH, _JOINED, 1),
    _choice("air.right_mode", 106, AIR_MODES, _VALVES),
    _number("air.right_target", 108, "bar", (0.0, 9 * bar), 1 * mbar, _TARGET),
    _choice("air.right_reservoir", 110, SWITCH, _JOINED, 1),
    _number(
        "rig.nominal_preload",
        112,
        "kN",
        (0.0, 160 * kN),
        10 * N,
        "Load per spring for which the shims set the height to zero; only without load on the actuators",
        53.5 * kN,
    ),
    _choice("air.dpv", 114, SWITCH, "on: differential pressure valve between the sides connected", 1),
    _choice("vertical.control", 116, CONTROL_MODES, "Control mode of both vertical actuators", 1),
    _choice("lateral.control", 118, CONTROL_MODES, "Control mode of the lateral actuator", 1),
    _choice("generator.axis", 120, AXES, "What the function generator moves"),
    _choice("generator.wave", 122, WAVES, "Waveform; all but the cosine begin and end with one soft cycle"),
    _number(
        "generator.amplitude",
        124,
        "mm",
        (0.0, 100 * mm),
        0.01 * mm,
        "Amplitude in displacement control",
    ),
    _number("generator.roll_amplitude", 126, "mrad", (0.0, 0.15 * rad), 0.01 * mrad, "Amplitude of a roll"),
    _number("generator.force_amplitude", 128, "kN", (0.0, 60 * kN), 10 * N, "Amplitude in force control"),
    _number("generator.frequency", 130, "Hz", (0.001, 30.0), 0.001, "Frequency of the wave", 1.0),
    _number("generator.cycles", 132, "1", (1, 1000), 1, "Whole cycles, the soft ones included", 1),
    _number(
        "rig.orifice_diameter",
        134,
        "mm",
        (5 * mm, 40 * mm),
        0.1 * mm,
        "Orifice plates fitted on both sides; changed by hand: only disengaged and without pressure",
        13 * mm,
    ),
    _choice(
        "rig.pipe",
        136,
        SWITCH,
        f"on: connecting pipes of {PIPE_LENGTH / m:g} m in series with the orifices; changed by hand as the plates are",
    ),
    _number(
        "generator.delay",
        138,
        "s",
        (0.0, 60 * s),
        1 * ms,
        "From the start of the program to that of this wave",
    ),
    *_CAR,
)


def _coil(name: str, address: int, text: str) -> Signal:
    return Signal(f"action.{name}", Kind.ACTION, "1", 0, 1, 1, text, SWITCH, address=address)


ACTIONS: Final = (
    _coil("apply", 0, "Take over all staged settings at once"),
    _coil("reset", 1, "Clear a latched fault (never an emergency stop that is still pressed)"),
    _coil("power_on", 2, "OFF to BOOT"),
    _coil("power_off", 3, "Any state without a fault to OFF"),
    _coil("air_low", 4, "Supply open, flow restricted"),
    _coil("air_high", 5, "Supply open, full flow"),
    _coil("disable", 6, "To DISABLED: held, vented, set down, unloaded"),
    _coil("program_run", 7, "Start or continue the function generator"),
    _coil("program_hold", 8, "Freeze the function generator where it is"),
    _coil("program_stop", 9, "Stop the function generator; what it moves returns softly"),
    _coil(
        "program_add",
        10,
        f"Keep the wave that is set: the next run starts all that were kept, {WAVES_AT_ONCE} at the most, at once",
    ),
    _coil(
        "program_car",
        11,
        "Start a ride of the car that is set: the springs' forces move it, it moves the springs",
    ),
)


def _contact(name: str, address: int, text: str) -> Signal:
    return Signal(f"interlock.{name}", Kind.INTERLOCK, "1", 0, 1, 1, text, SWITCH, address=address)


INTERLOCKS: Final = (
    _contact("estop", 0, "The hard-wired emergency stop is pressed"),
    _contact("pneumatic", 1, "The interlock that removes pressure is open"),
    _contact("program", 2, "The interlock that stops the program is open"),
    _contact("command", 3, "Valid commands arrive in time"),
    _contact("limits", 4, "A limit detector has tripped, or stands since it was reset"),
    _contact("fault", 5, "A fault is latched"),
    _contact("staged", 6, "Settings are staged and not yet applied"),
)

#: Sensors that plans and descriptions support, but our bench does not have.
FURTHER: Final = tuple(
    Signal(
        f"load_cell.{number}",
        Kind.FURTHER,
        *_range(Group.VERTICAL_LOAD_CELL),
        f"Load cell {number}: where the description of the rig puts it",
        group=Group.VERTICAL_LOAD_CELL,
    )
    for number in (7, 8)
)

#: The names of the measurements of each group.
BY_GROUP: Final = {group: tuple(row.name for row in MEASUREMENTS if row.group is group) for group in Group}
PRESSURES: Final = BY_GROUP[Group.PRESSURE]

SIGNALS: Final = (*MEASUREMENTS, *STATUS, *SETPOINTS, *SETTINGS, *ACTIONS, *INTERLOCKS, *FURTHER)
