"""The state of the tick as one record: set-points, generator, air control and watchdog. Also the periods
of the tick.
"""

from dataclasses import asdict
from enum import IntEnum, IntFlag
from typing import Final

import numpy as np

from bench_protocol.car import MovingCar
from bench_protocol.rates import COMMAND_RATE, DISABLE_AFTER, FAST_RATE, HOLD_AFTER, SLOW_RATE, TICK
from bench_protocol.table_signals import COUNT_MAX
from bench_protocol.units import NS, s
from bench_protocol.words import WAVES_AT_ONCE
from bench_sim.model.layout import SENSORS, Sensor

TICK_NS: Final = round(TICK * NS)
#: The number of the tick on the wires: 24 bits with one code left for "unknown".
TICK_MODULUS: Final = int(COUNT_MAX) + 1
#: Ticks between samples at the three rates of the messages.
FAST: Final = round(1.0 / (FAST_RATE * TICK))
MEDIUM: Final = round(1.0 / (COMMAND_RATE * TICK))
SLOW: Final = round(1.0 / (SLOW_RATE * TICK))
#: Ticks without a valid command after which they count as late, and as lost.
LATE_TICKS: Final = round(HOLD_AFTER / TICK)
LOST_TICKS: Final = round(DISABLE_AFTER / TICK)
#: Ticks of silence on both buses after which a commander loses the bench, even if its connections are open.
GONE_TICKS: Final = round(2 * s / TICK)
#: Guessing a token: after so many wrong ones a connection can no longer command under this lease, and after so many
#: such connections no other one can either. Together 80 tries of 65 533 tokens. A client that still sends the token
#: of its last lease for up to 0.2 s is not shut out.
TRIES_MAX: Final = 10
SUSPECTS_MAX: Final = 8
#: Set-points arrive at COMMAND_RATE; the rig draws a straight line to each within one such period.
SLEW_TICKS: Final = MEDIUM


class Target(IntEnum):
    """The indices of the set-points in the arrays of the tick."""

    VERTICAL_LEFT = 0
    VERTICAL_RIGHT = 1
    LATERAL = 2
    PLATFORM_VERTICAL = 3
    PLATFORM_LATERAL = 4
    PLATFORM_ROLL = 5


TARGETS: Final = len(Target)
#: The transducer of each set-point's position control.
HOLDING: Final = tuple(
    Sensor[target.name if target >= Target.PLATFORM_VERTICAL else f"{target.name}_DISPLACEMENT"]
    for target in Target
)


class AirSupply(IntEnum):
    """How much the air supply may do in the present state of the bench."""

    SHUT = 0
    RESTRICTED = 1
    FULL = 2
    VENTED = 3  #: safe position: supply shut, springs open to the atmosphere


class ControlBit(IntFlag):
    """The bits of the Control message, in the order of its fields."""

    NONE = 0
    ENABLE = 1  #: D
    HOLD = 2  #: H
    ACTIVE = 4  #: M
    RESET = 8  #: R


class Happened(IntFlag):
    """Events in a tick that the state machine must handle."""

    NOTHING = 0
    COMMAND_LATE = 1
    COMMAND_LOST = 2
    LIMIT = 4
    PROGRAM_DONE = 8
    ALARM = 16
    WRITES_LOST = 32  #: the holder of the lease has stopped writing
    LEASE_LOST = 64  #: the holder is silent: a commander on both wires, or one without a connection
    NODE = 256  #: the CANopen node has something to do
    TICK_LOST = 128
    COMMANDED = 512  #: control bits have changed, or a user asks for the lease
    FAULT = 1024  #: a fault on purpose begins or ends
    SPRING_LOST = 8192  #: the computation of the springs has failed
    RECORDED = 2048  #: the black box has recorded the ten seconds after an incident
    ASTRAY = 4096  #: the ride of a car exceeded the range of the actuators, or had no force reading


#: Load cells.
CELLS: Final = Sensor.LOAD_CELL_6 - Sensor.LOAD_CELL_1 + 1
#: A car in the loop: `MovingCar`, and its coupling to the bench.
CAR: Final = np.dtype(
    [
        *((name, "<f8", np.shape(value)) for name, value in asdict(MovingCar()).items()),
        ("track_size", "<f8", (3,)),  # height of a wave of the track, each way
        ("lead", "<f8", (TARGETS,)),  # time in s by which each set-point is sent ahead
        ("of_cells", "<f8", (3, CELLS)),  # force and moment of the springs for one newton on each cell
        ("to_targets", "<f8", (TARGETS, 6)),  # set-points by position of the springs and by their forces
        ("rest", "<f8", (CELLS,)),  # readings of the cells at rest
        ("delivered", "<f8", (SENSORS,)),  # room to read in
        ("readings", "<f8", (SENSORS,)),
    ]
)

#: A snapshot of the rig's tick is a copy of this record.
CONTROLS: Final = np.dtype(
    [
        ("tick", "<i8"),
        ("alarm", "<i8"),  # tick at which the state machine must be called, -1 for never
        ("command_tick", "<i8"),  # time of the last valid command
        ("bits", "<i8"),  # `ControlBit` of the last valid command
        ("changed", "<i8"),  # number of changes since the last query of the supervisor
        ("token", "<i8"),  # of the lease, 0 without a holder
        # `peers.sender_of` the connection by which the holder commands, 0 on SocketCAN, -1 before it has proven itself
        ("commander", "<i8"),
        # connections that sent a wrong token without a known commander, and their number of attempts
        ("suspects", "<i8", (SUSPECTS_MAX,)),
        ("tries", "<i8", (SUSPECTS_MAX,)),
        ("granted", "<i8"),  # time of the grant of the lease
        ("expiring", "<i8"),  # 1: no connection ends the lease, only silence does
        (
            "asked",
            "<i8",
        ),  # 1: a user has asked for the lease on CAN: from where, by which nonce, with which token
        ("asked_sender", "<i8"),
        ("asked_nonce", "<i8"),
        ("asked_token", "<i8"),
        ("write_tick", "<i8"),  # time of the last write by the holder of the lease
        ("write_deadline", "<i8"),  # tick by which the holder of the lease must have written, -1 for never
        ("fault_tick", "<i8"),  # tick at which a fault on purpose begins or ends, -1 for never
        ("refitted", "<i8"),  # 1: plates or pipes have been changed since the last tick
        ("springless", "<i8"),  # 1: springs from elsewhere are lost, and it has been said
        ("armed", "<i8"),  # 1: the watchdog is watching
        ("late", "<i8"),  # 1: already reported
        ("lost", "<i8"),
        ("active", "<i8"),  # 1: follow the commander's set-points
        ("engaged", "<i8"),  # 1: the actuators hold or move
        ("shut_in", "<i8"),  # 1: the actuators stay shut in, with or without pressure
        ("ordered", "<i8"),  # 1: a set-point has come for actuators that are still shut in
        ("airing", "<i8"),  # samples for which the springs stay open, or until settings are applied
        ("grip", "<i8"),  # `safe_position.Grip`
        ("lowering", "<i8", (2,)),  # 1: this vertical actuator sets down its load
        ("air", "<i8"),  # `AirSupply`
        ("control", "<i8", (3,)),  # control mode by actuator
        ("goal", "<f8", (TARGETS,)),
        ("setpoint", "<f8", (TARGETS,)),
        ("zero", "<f8", (TARGETS,)),  # zero reading of the transducer that controls this position
        ("slew", "<i8", (TARGETS,)),  # ticks until the goal, if it is not too far away
        ("refused", "<i8"),  # frames of set-points out of range
        ("air_mode", "<i8", (2,)),
        ("air_target", "<f8", (2,)),
        ("reservoir", "<i8", (2,)),
        ("dpv", "<i8"),
        ("program", "<i8"),  # `Program`
        ("waves", "<i8"),  # number of waves of the program
        ("wave", "<i8", (WAVES_AT_ONCE,)),
        ("amplitude", "<f8", (WAVES_AT_ONCE, TARGETS)),  # by set-point: 0 where the wave moves none
        ("frequency", "<f8", (WAVES_AT_ONCE,)),
        ("cycles", "<f8", (WAVES_AT_ONCE,)),
        ("phase", "<f8", (WAVES_AT_ONCE,)),  # cycles since the start of the wave, below 0 before
        ("offset", "<f8", (TARGETS,)),  # offsets of the generator on the set-points
        ("riding", "<i8"),  # 1: the program is a ride of a car in the loop
        ("resting", "<i8"),  # ticks for which the cells are read before it, and the remaining ones
        ("waits", "<i8"),
        ("wind_goal", "<f8"),  # N
        ("wind", "<f8"),
        ("wind_slew", "<i8"),  # ticks until the goal
        ("car", CAR),
        ("node_state", "<i8"),  # `bench_protocol.canopen.NmtState`
        ("heartbeat", "<i8"),  # ticks between two of the node's heartbeats, 0 for none
        ("heartbeat_due", "<i8"),  # tick of the next
        (
            "guard_due",
            "<i8",
        ),  # deadline tick of the commander's heartbeat, -1 if none is expected
        ("sync_due", "<i8"),  # tick of the next SYNC, -1 for never
    ]
)
