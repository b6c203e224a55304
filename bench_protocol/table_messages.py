"""The CAN messages of the table: identifier, rate and fields of every frame, one message each.

An identifier and the place of a field never change; a new field is added behind the others.
"""

from typing import Final

from bench_protocol.messages import TOKEN, Field, Message, Protection
from bench_protocol.rates import COMMAND_RATE, FAST_RATE, SLOW_RATE
from bench_protocol.units import N
from bench_protocol.words import ACTUATORS, PLATFORM_AXES, SIDES


def _fields(*names: str, bits: int = 16, step: float = 0.0) -> tuple[Field, ...]:
    return tuple(Field(name, bits, step) for name in names)


def _message(name: str, identifier: int, rate: float, fields: tuple[Field, ...], text: str) -> Message:
    return Message(name, identifier, rate, True, fields, Protection.COUNTER, text)


def _command(
    name: str, identifier: int, fields: tuple[Field, ...], text: str, *, rate: float = COMMAND_RATE
) -> Message:
    """Return a message of the commander; a message without a token field carries the token in its CRC."""
    bound = not any(field.signal.endswith(".token") for field in fields)
    return Message(
        name, identifier, rate, False, fields, Protection.E2E, text, 0x0A00 | identifier, bound=bound
    )


def _word(signal: str) -> Field:
    """Return a field of 16 bits in which every code is a value."""
    return Field(signal, 16, signed=False, nullable=False)


def _spring(side: str) -> tuple[Field, ...]:
    return _fields(f"{side}.height", f"{side}.bellows_pressure", f"{side}.auxiliary_pressure")


MESSAGES: Final = (
    _message("SpringLeft", 0x181, FAST_RATE, _spring("left"), "The left air spring"),
    _message("SpringRight", 0x182, FAST_RATE, _spring("right"), "The right air spring"),
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
        "Once for every new error, and once when all are over, as CANopen devices do",
    ),
    _message("Supply", 0x384, SLOW_RATE, _fields("supply.pressure"), "The air supply"),
    _message(
        "FirstOut",
        0x385,
        SLOW_RATE,
        (
            Field("rig.tripped_kind", 8, signed=False),
            Field("rig.tripped_value", 16),
            Field("rig.tripped_tick", 24, signed=False),
        ),
        "The limit that tripped first",
    ),
    _message(
        "Refusals",
        0x386,
        SLOW_RATE,
        (Field("rig.refused_setpoints", 16, signed=False),),
        "What the rig did not follow",
    ),
    _message(
        "Lease",
        0x387,
        SLOW_RATE,
        (_word("rig.lease"), _word("rig.holder"), _word("lease.nonce")),
        "Who holds the bench, and whose request was answered last; also at once when that changes",
    ),
    _message(
        "Strangers",
        0x388,
        SLOW_RATE,
        (
            Field("rig.strangers", 24, signed=False),
            _word("rig.stranger"),
            _word("rig.stranger_identifier"),
        ),
        "Who else tried to command the bench",
    ),
    _message(
        "CarSprings",
        0x284,
        COMMAND_RATE,
        _fields("car.shear", "car.height", "car.roll"),
        "How the car in the loop has its springs",
    ),
    _message(
        "CarMotion",
        0x285,
        COMMAND_RATE,
        _fields("car.acceleration", "car.rising", "car.bump_stop", "car.wind", bits=14),
        "What the car in the loop does",
    ),
    _command(
        "Control",
        0x201,
        (
            *(
                Field(f"control.{name}", 1, signed=False, nullable=False)
                for name in ("enable", "hold", "active", "reset")
            ),
            _word(TOKEN),
        ),
        "Feeds the watchdog and asks for a state",
    ),
    _command(
        "ForceSetpoints",
        0x202,
        _fields(*(f"{a}.force_setpoint" for a in ACTUATORS)),
        "Set-points for actuators in force control",
    ),
    _command(
        "DisplacementSetpoints",
        0x203,
        _fields(*(f"{a}.displacement_setpoint" for a in ACTUATORS)),
        "Set-points for actuators in displacement control",
    ),
    _command(
        "PlatformSetpoints",
        0x204,
        _fields(*(f"platform.{axis}_setpoint" for axis in PLATFORM_AXES)),
        "Set-points for the vibration platform",
    ),
    _command("CarWind", 0x206, _fields("car.wind_setpoint"), "Wind on the car in the loop"),
    _command(
        "LeaseRequest",
        0x205,
        (_word("lease.nonce"), _word("lease.token")),
        "Asks for the bench where there is no Modbus, or returns it; the rig answers with Lease",
        rate=0.0,
    ),
)
