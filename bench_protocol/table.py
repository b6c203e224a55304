"""THE table of signals: every value that crosses the wires of the bench, once.

CAN messages, Modbus registers, the DBC, the map hash, the drivers' attributes and the reference page all come from
here. Pressures on the wires are gauge; displacements are positive upward and to the left (+y), vertical actuator
forces positive downward (a preload is positive), lateral forces positive to the left.
"""

from typing import Final

from bench_protocol.signals import Field, Kind, Message, Protection, Register, Signal, Table
from bench_protocol.units import K, N, bar, kN, mbar, mm, mrad, ms, rad, us

STATES: Final = (
    "OFF",
    "BOOT",
    "INIT",
    "DISABLED",
    "AIR_LOW",
    "AIR_HIGH",
    "HOLD",
    "ACTIVE",
    "FAULT_REACTION",
    "FAULT_HOLD",
    "FAULT_DISABLED",
    "ESTOP",
)
PROGRAM_STATES: Final = ("IDLE", "RUN", "HOLD", "STOPPED")
REASONS: Final = (
    "none",
    "command late",
    "command lost",
    "commander disconnected",
    "emergency stop",
    "limit tripped",
    "tick lost",
    "disabled by the commander",
)
AIR_MODES: Final = ("hold", "level", "fill", "vent")
CONTROL_MODES: Final = ("off", "force", "displacement")
AXES: Final = ("vertical", "roll", "lateral", "platform_vertical", "platform_lateral", "platform_roll")
WAVES: Final = ("sine", "unilateral_cosine", "triangle")
SWITCH: Final = ("off", "on")

SIDES: Final = ("left", "right")
ACTUATORS: Final = ("vertical_left", "vertical_right", "lateral")
COUNT_MAX: Final = float(2**24 - 2)  # what 24 bits on CAN and a float32 register both hold exactly


def _measured(name: str, unit: str, span: tuple[float, float], step: float, text: str) -> Signal:
    return Signal(name, Kind.MEASUREMENT, unit, *span, step, text)


def _measurements() -> list[Signal]:
    rows: list[Signal] = []
    for side in SIDES:
        rows += [
            _measured(
                f"{side}.height",
                "mm",
                (-300 * mm, 300 * mm),
                0.01 * mm,
                "Laser: spring height over design height",
            ),
            _measured(
                f"{side}.bellows_pressure",
                "bar",
                (-1 * bar, 15 * bar),
                0.5 * mbar,
                "Gauge pressure in the bellows",
            ),
            _measured(
                f"{side}.auxiliary_pressure",
                "bar",
                (-1 * bar, 15 * bar),
                0.5 * mbar,
                "Gauge pressure in the auxiliary chamber",
            ),
        ]
    spans = {"vertical_left": 200 * kN, "vertical_right": 200 * kN, "lateral": 60 * kN}
    for actuator, span in spans.items():
        step = 10 * N if span > 100 * kN else 2 * N
        rows += [
            _measured(f"{actuator}.force", "kN", (-span, span), step, "Force transducer of the actuator"),
            _measured(
                f"{actuator}.displacement",
                "mm",
                (-300 * mm, 300 * mm),
                0.01 * mm,
                "Displacement transducer of the actuator",
            ),
        ]
    for cell in range(1, 7):
        span, step = (200 * kN, 25 * N) if cell <= 4 else (60 * kN, 2 * N)
        place = "vertical cell under the platform" if cell <= 4 else "lateral cell under the platform"
        rows.append(_measured(f"load_cell.{cell}", "kN", (-span, span), step, f"Load cell {cell}: {place}"))
    rows.append(
        _measured(
            "lateral.acceleration", "m/s2", (-30.0, 30.0), 0.001, "Accelerometer at the centre of the bolster"
        )
    )
    rows.append(
        _measured("supply.pressure", "bar", (-1 * bar, 15 * bar), 0.5 * mbar, "Gauge pressure of the supply")
    )
    for side in SIDES:
        for chamber in ("bellows", "auxiliary"):
            rows.append(
                _measured(
                    f"{side}.{chamber}_temperature",
                    "K",
                    (200 * K, 400 * K),
                    0.05 * K,
                    f"Gas in the {chamber}, 1 s lag",
                )
            )
    rows += [
        _measured("platform.vertical", "mm", (-150 * mm, 150 * mm), 0.01 * mm, "Vibration platform, up"),
        _measured("platform.lateral", "mm", (-150 * mm, 150 * mm), 0.01 * mm, "Vibration platform, left"),
        _measured(
            "platform.roll", "mrad", (-0.3 * rad, 0.3 * rad), 0.01 * mrad, "Vibration platform, left side up"
        ),
    ]
    return rows


def _status() -> list[Signal]:
    def choice(name: str, choices: tuple[str, ...], text: str) -> Signal:
        return Signal(name, Kind.STATUS, "1", 0, len(choices) - 1, 1, text, choices)

    def count(name: str, text: str, high: float = COUNT_MAX, unit: str = "1", step: float = 1.0) -> Signal:
        return Signal(name, Kind.STATUS, unit, 0, high, step, text)

    return [
        choice("rig.state", STATES, "State of the bench"),
        choice("rig.program", PROGRAM_STATES, "State of the function generator's program"),
        choice("rig.reason", REASONS, "Why the bench left ACTIVE; the first cause stays until a reset"),
        count("rig.tripped", "Row in the table of the signal whose limit tripped first, plus one", 255),
        count("rig.status_code", "0 disabled, 1xx idle, 2xx warning, 3xx busy, 4xx error", 499),
        count("rig.lease", "Token of the commander that holds the bench, 0 if nobody", 65535),
        count("rig.generator_cycle", "Cycles that the function generator has completed", 65534),
        count("rig.tick", "Ticks since start, modulo 2^24 - 1 (0 follows 16777214)"),
        count("rig.late_ticks", "Ticks that began more than one period after their deadline", 65534),
        count("rig.lateness_max", "Largest lateness of a tick since start", 65534 * us, "us", 1 * us),
        count("rig.rejected_commands", "Command frames refused by their end-to-end protection", 65534),
        count(
            "emergency.code",
            "CANopen emergency: 0 no error, 0x8130 command lost, 0xFF01 limit, 0xFF02 stop",
            65534,
        ),
        count("emergency.register", "CANopen error register", 254),
        count("emergency.reason", "Number of the reason, as in rig.reason", 254),
        count("rig.map_hash", "First 32 bits of the hash of this table", float(2**32 - 1)),
        *(
            count(f"rig.lateness_{name}", f"Ticks that began {text} after their deadline")
            for name, text in (
                ("50us", "less than 50 us"),
                ("100us", "50 to 100 us"),
                ("250us", "100 to 250 us"),
                ("500us", "250 to 500 us"),
                ("1ms", "0.5 to 1 ms"),
                ("more", "1 ms or more"),
            )
        ),
    ]


def _setpoints() -> list[Signal]:
    def bit(name: str, text: str) -> Signal:
        return Signal(name, Kind.SETPOINT, "1", 0, 1, 1, text, SWITCH)

    rows = [
        bit("control.enable", "D: leave INIT; clearing it disables the bench"),
        bit("control.hold", "H: HOLD or higher; clearing it unloads the actuators"),
        bit("control.active", "M: ACTIVE; clearing it holds the present value"),
        bit("control.reset", "R: its rising edge resets a fault and leaves DISABLED"),
    ]
    for actuator in ACTUATORS:
        span, step = (200 * kN, 10 * N) if actuator != "lateral" else (60 * kN, 2 * N)
        rows.append(
            Signal(
                f"{actuator}.force_setpoint", Kind.SETPOINT, "kN", -span, span, step, "Used in force control"
            )
        )
    for actuator in ACTUATORS:
        rows.append(
            Signal(
                f"{actuator}.displacement_setpoint",
                Kind.SETPOINT,
                "mm",
                -300 * mm,
                300 * mm,
                0.01 * mm,
                "Used in displacement control",
            )
        )
    for axis in ("vertical", "lateral"):
        rows.append(
            Signal(
                f"platform.{axis}_setpoint",
                Kind.SETPOINT,
                "mm",
                -150 * mm,
                150 * mm,
                0.01 * mm,
                "Vibration platform",
            )
        )
    rows.append(
        Signal(
            "platform.roll_setpoint",
            Kind.SETPOINT,
            "mrad",
            -0.3,
            0.3,
            0.01 * mrad,
            "Vibration platform, left up",
        )
    )
    return rows


def _settings() -> list[Signal]:
    def choice(name: str, choices: tuple[str, ...], text: str, default: int = 0) -> Signal:
        return Signal(name, Kind.SETTING, "1", 0, len(choices) - 1, 1, text, choices, default)

    def number(
        name: str, unit: str, span: tuple[float, float], step: float, text: str, default: float = 0
    ) -> Signal:
        return Signal(name, Kind.SETTING, unit, *span, step, text, (), default)

    rows = []
    for side in SIDES:
        rows += [
            choice(
                f"air.{side}_mode",
                AIR_MODES,
                "hold: all valves shut; level: leveling valve; fill: to the target",
            ),
            number(
                f"air.{side}_target",
                "bar",
                (0.0, 9 * bar),
                1 * mbar,
                "Gauge pressure that fill and vent aim for",
            ),
            choice(
                f"air.{side}_reservoir", SWITCH, "on: bellows and auxiliary chamber joined by the orifice", 1
            ),
        ]
    rows += [
        number(
            "rig.nominal_preload",
            "kN",
            (0.0, 160 * kN),
            10 * N,
            "Load per spring for which the shims set the height to zero; only without load on the actuators",
            53.5 * kN,
        ),
        choice("air.dpv", SWITCH, "on: differential pressure valve between the sides connected", 1),
        choice("vertical.control", CONTROL_MODES, "Control mode of both vertical actuators", 1),
        choice("lateral.control", CONTROL_MODES, "Control mode of the lateral actuator", 1),
        choice("generator.axis", AXES, "What the function generator moves"),
        choice("generator.wave", WAVES, "Waveform; sines and triangles start and end with one soft cycle"),
        number("generator.amplitude", "mm", (0.0, 100 * mm), 0.01 * mm, "Amplitude in displacement control"),
        number("generator.roll_amplitude", "mrad", (0.0, 0.15 * rad), 0.01 * mrad, "Amplitude of a roll"),
        number("generator.force_amplitude", "kN", (0.0, 60 * kN), 10 * N, "Amplitude in force control"),
        number("generator.frequency", "Hz", (0.001, 30.0), 0.001, "Frequency of the wave", 1.0),
        number("generator.cycles", "1", (1, 1000), 1, "Whole cycles, the soft ones included", 1),
        number(
            "rig.orifice_diameter",
            "mm",
            (5 * mm, 40 * mm),
            0.1 * mm,
            "Orifice plates fitted on both sides; changed by hand: only disengaged and without pressure",
            13 * mm,
        ),
        choice(
            "rig.pipe",
            SWITCH,
            "on: connecting pipes of 1.5 m in series with the orifices; changed by hand as the plates are",
        ),
    ]
    return rows


def _actions() -> list[Signal]:
    def coil(name: str, text: str) -> Signal:
        return Signal(f"action.{name}", Kind.ACTION, "1", 0, 1, 1, text, SWITCH)

    return [
        coil("apply", "Take over all staged settings at once"),
        coil("reset", "Clear a latched fault (never an emergency stop that is still pressed)"),
        coil("power_on", "OFF to BOOT"),
        coil("power_off", "Any state without a fault to OFF"),
        coil("air_low", "Supply open, flow restricted"),
        coil("air_high", "Supply open, full flow"),
        coil("disable", "To DISABLED: actuators unloaded softly, valves shut"),
        coil("program_run", "Start or continue the function generator"),
        coil("program_hold", "Freeze the function generator where it is"),
        coil("program_stop", "Stop the function generator; the axis returns softly"),
    ]


def _interlocks() -> list[Signal]:
    def contact(name: str, text: str) -> Signal:
        return Signal(f"interlock.{name}", Kind.INTERLOCK, "1", 0, 1, 1, text, SWITCH)

    return [
        contact("estop", "The hard-wired emergency stop is pressed"),
        contact("pneumatic", "The interlock that removes pressure is open"),
        contact("program", "The interlock that stops the program is open"),
        contact("command", "Valid commands arrive in time"),
        contact("limits", "A limit detector has tripped"),
        contact("fault", "A fault is latched"),
        contact("staged", "Settings are staged and not yet applied"),
    ]


def _fields(*names: str, bits: int = 16, step: float = 0.0) -> tuple[Field, ...]:
    return tuple(Field(name, bits, step) for name in names)


def _message(
    name: str, identifier: int, rate: float, fields: tuple[Field, ...], text: str, *, from_rig: bool = True
) -> Message:
    protection = Protection.COUNTER if from_rig else Protection.E2E
    return Message(
        name, identifier, rate, from_rig, fields, protection, text, 0 if from_rig else 0x0A00 | identifier
    )


FAST_RATE: Final = 200.0
COMMAND_RATE: Final = 50.0
SLOW_RATE: Final = 10.0

_MESSAGES: Final = (
    *(
        _message(
            f"Spring{side.capitalize()}",
            0x181 + row,
            FAST_RATE,
            _fields(f"{side}.height", f"{side}.bellows_pressure", f"{side}.auxiliary_pressure"),
            f"The {side} air spring",
        )
        for row, side in enumerate(SIDES)
    ),
    _message(
        "ActuatorForces", 0x183, FAST_RATE, _fields(*(f"{a}.force" for a in ACTUATORS)), "The three actuators"
    ),
    _message(
        "ActuatorDisplacements",
        0x184,
        FAST_RATE,
        _fields(*(f"{a}.displacement" for a in ACTUATORS)),
        "The three actuators",
    ),
    _message(
        "LoadCells",
        0x185,
        FAST_RATE,
        _fields(*(f"load_cell.{cell}" for cell in range(1, 5)), bits=14, step=25 * N),
        "The vertical load cells",
    ),
    _message(
        "Lateral",
        0x186,
        FAST_RATE,
        _fields("load_cell.5", "load_cell.6", "lateral.acceleration"),
        "The lateral load cells and the accelerometer",
    ),
    _message(
        "Platform",
        0x281,
        COMMAND_RATE,
        _fields("platform.vertical", "platform.lateral", "platform.roll"),
        "The vibration platform",
    ),
    _message(
        "State",
        0x282,
        COMMAND_RATE,
        (
            Field("rig.state", 8, signed=False),
            Field("rig.program", 4, signed=False),
            Field("rig.reason", 4, signed=False),
            Field("rig.tripped", 9, signed=False),
            Field("rig.status_code", 10, signed=False),
            Field("rig.generator_cycle", 16, signed=False),
        ),
        "What the bench is doing and why",
    ),
    _message(
        "Timing",
        0x381,
        SLOW_RATE,
        (
            Field("rig.tick", 24, signed=False),
            Field("rig.late_ticks", 16, signed=False),
            Field("rig.lateness_max", 16, signed=False),
        ),
        "How well the tick keeps time",
    ),
    _message(
        "Temperatures",
        0x382,
        SLOW_RATE,
        _fields(
            *(f"{side}.{part}_temperature" for side in SIDES for part in ("bellows", "auxiliary")), bits=14
        ),
        "The gas",
    ),
    _message(
        "Identity",
        0x383,
        SLOW_RATE,
        (
            Field("rig.map_hash", 32, signed=False, nullable=False),
            Field("rig.rejected_commands", 16, signed=False),
        ),
        "Which table of signals the bench speaks",
    ),
    Message(
        "Emergency",
        0x081,
        0.0,
        True,
        (
            Field("emergency.code", 16, signed=False),
            Field("emergency.register", 8, signed=False),
            Field("emergency.reason", 8, signed=False),
        ),
        Protection.NONE,
        "Once on entering a fault and once on leaving it, as CANopen devices do",
    ),
    _message("Supply", 0x384, SLOW_RATE, _fields("supply.pressure"), "The air supply"),
    _message(
        "Control",
        0x201,
        COMMAND_RATE,
        tuple(
            Field(f"control.{name}", 1, signed=False, nullable=False)
            for name in ("enable", "hold", "active", "reset")
        ),
        "Feeds the watchdog and asks for a state",
        from_rig=False,
    ),
    _message(
        "ForceSetpoints",
        0x202,
        COMMAND_RATE,
        _fields(*(f"{a}.force_setpoint" for a in ACTUATORS)),
        "Set-points for actuators in force control",
        from_rig=False,
    ),
    _message(
        "DisplacementSetpoints",
        0x203,
        COMMAND_RATE,
        _fields(*(f"{a}.displacement_setpoint" for a in ACTUATORS)),
        "Set-points for actuators in displacement control",
        from_rig=False,
    ),
    _message(
        "PlatformSetpoints",
        0x204,
        COMMAND_RATE,
        _fields(*(f"platform.{axis}_setpoint" for axis in ("vertical", "lateral", "roll"))),
        "Set-points for the vibration platform",
        from_rig=False,
    ),
)

#: Modbus addresses that clients may rely on.
SEQUENCE_ADDRESS: Final = 0
PROBE_FLOAT: Final = 3.14159
PROBE_WORD: Final = 0x12345678
FLOAT_BLOCK: Final = 100
SCALED_BLOCK: Final = 300
LEASE_ADDRESS: Final = 0
WATCHDOG_ADDRESS: Final = 1
SETTINGS_BLOCK: Final = 100


def _registers(signals: list[Signal]) -> tuple[Register, ...]:
    """Lay out the Modbus map: two coherent blocks of readings (floats and scaled twins), settings, coils, contacts."""
    readings = [signal for signal in signals if signal.kind in (Kind.MEASUREMENT, Kind.STATUS)]
    rows = [
        Register("modbus.sequence", "input", SEQUENCE_ADDRESS, "uint16"),
        Register("modbus.map_hash", "input", 1, "uint32"),
        Register("modbus.probe_float", "input", 3, "float32"),
        Register("modbus.probe_word", "input", 5, "uint32"),
        Register("modbus.sequence", "input", FLOAT_BLOCK - 1, "uint16"),
        *(Register(r.name, "input", FLOAT_BLOCK + 2 * k, "float32") for k, r in enumerate(readings)),
        Register("modbus.sequence", "input", FLOAT_BLOCK + 2 * len(readings), "uint16"),
        Register("modbus.sequence", "input", SCALED_BLOCK - 1, "uint16"),
        *(Register(r.name, "input", SCALED_BLOCK + k, "int16") for k, r in enumerate(readings)),
        Register("modbus.sequence", "input", SCALED_BLOCK + len(readings), "uint16"),
        Register("modbus.lease", "holding", LEASE_ADDRESS, "uint16"),
        Register("modbus.watchdog", "holding", WATCHDOG_ADDRESS, "uint16"),
    ]
    settings = [signal for signal in signals if signal.kind is Kind.SETTING]
    rows += [Register(r.name, "holding", SETTINGS_BLOCK + 2 * k, "float32") for k, r in enumerate(settings)]
    coils = [signal for signal in signals if signal.kind is Kind.ACTION]
    rows += [Register(r.name, "coil", k, "bit") for k, r in enumerate(coils)]
    contacts = [signal for signal in signals if signal.kind is Kind.INTERLOCK]
    rows += [Register(r.name, "discrete", k, "bit") for k, r in enumerate(contacts)]
    rows += [Register(r.name, "discrete", FLOAT_BLOCK + k, "bit") for k, r in enumerate(readings)]
    return tuple(rows)


def _table() -> Table:
    signals = [*_measurements(), *_status(), *_setpoints(), *_settings(), *_actions(), *_interlocks()]
    return Table(tuple(signals), _MESSAGES, _registers(signals))


TABLE: Final = _table()

#: The rig's tick, and how long it waits for a valid command.
TICK: Final = 1 * ms
HOLD_AFTER: Final = 100 * ms
DISABLE_AFTER: Final = 500 * ms
