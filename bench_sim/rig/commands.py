"""Applies CAN commands to the controls of the tick: it accepts only the commander, and sets the goals of the
set-points.

Refused frames are counted. All functions are compiled and work on arrays, with one block of frames from one sender at
a time.
"""

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.can_codec import NOBODY, Decoder, Tally, data_word, decode_into
from bench_protocol.e2e import crc8
from bench_protocol.frames import FRAME, LENGTH_MAX, Block
from bench_protocol.runtime.ring import Ring, take
from bench_protocol.table import TABLE
from bench_protocol.words import ACTUATORS, PLATFORM_AXES
from bench_sim.model.compiled import compiled
from bench_sim.model.layout import Mode
from bench_sim.rig.controls import SLEW_TICKS, TICK_NS, TRIES_MAX, ControlBit, Happened, Target
from bench_sim.rig.peers import PORT_MASK
from bench_sim.rig.setpoints import frames_of_setpoints, outside, ranges

#: Frames that are taken in one tick, and that wait at most: a flood beyond loses the oldest.
_FRAMES_MAX: Final = 1024
_WAITING_MAX: Final = 65_536
_CONTROL_ROW: Final = TABLE.index["control.enable"]
#: The bits of the Control message are in its fields and in the table in one order.
_CONTROL_BITS: Final = len(ControlBit)
assert TABLE.signals[_CONTROL_ROW : _CONTROL_ROW + _CONTROL_BITS] == tuple(
    TABLE[f"control.{bit.name.lower()}"] for bit in ControlBit if bit.name
)
#: A request for the lease brings its nonce and then its token.
_NONCE_ROW: Final = TABLE.index["lease.nonce"]
assert TABLE.index["lease.token"] == _NONCE_ROW + 1

_CONTROL: Final = TABLE.messages[TABLE.message_index["Control"]]
_CONTROL_IDENTIFIER: Final = _CONTROL.identifier
_CONTROL_DATA_ID: Final = _CONTROL.data_id
_TOKEN_BIT: Final = _CONTROL.token_bit

_LEASE_ROW: Final = TABLE.index["rig.lease"]
_REJECTED_ROW: Final = TABLE.index["rig.rejected_commands"]
_WIND_ROW: Final = TABLE.index["car.wind_setpoint"]
_STRANGERS_ROW: Final = TABLE.index["rig.strangers"]
_STRANGER_ROW: Final = TABLE.index["rig.stranger"]
_IDENTIFIER_ROW: Final = TABLE.index["rig.stranger_identifier"]


class Steering(NamedTuple):
    """Data of the set-points by table row: index of the moved axis (`Target`; -1: none), necessary control mode (-1:
    any), and range.
    """

    targets: npt.NDArray[np.int64]
    modes: npt.NDArray[np.int64]
    fields: npt.NDArray[np.int64]  #: of the frame of set-points that begins here, 0 where none does
    ranges: npt.NDArray[np.float64]  #: (n, 2)

    @classmethod
    def of_table(cls) -> "Steering":
        """Return this data for the set-points of the signal table."""
        targets, modes = np.full((2, len(TABLE.signals)), -1, np.int64)
        steering = cls(targets, modes, frames_of_setpoints(), ranges())
        for target, name in enumerate(ACTUATORS):
            for mode in (Mode.FORCE, Mode.DISPLACEMENT):
                row = TABLE.index[f"{name}.{mode.name.lower()}_setpoint"]
                steering.targets[row], steering.modes[row] = target, mode
        for axis, name in enumerate(PLATFORM_AXES):
            steering.targets[TABLE.index[f"platform.{name}_setpoint"]] = Target.PLATFORM_VERTICAL + axis
        return steering


class Receiving(NamedTuple):
    """Data for decoding commands: the layout of the messages, the state of the decoder, and buffers for samples."""

    rows: npt.NDArray[np.int64]
    messages: npt.NDArray[np.void]
    fields: npt.NDArray[np.void]
    counters: npt.NDArray[np.int64]
    times: npt.NDArray[np.int64]
    tally: npt.NDArray[np.int64]
    latest: npt.NDArray[np.float64]
    latest_times: npt.NDArray[np.int64]
    sample_times: npt.NDArray[np.int64]
    sample_signals: npt.NDArray[np.int64]
    sample_values: npt.NDArray[np.float64]

    @classmethod
    def of(cls, decoder: Decoder, frames_max: int) -> "Receiving":
        """Return the arrays of ``decoder``, with buffers for the samples of ``frames_max`` frames."""
        layout, room = decoder.layout, frames_max * int(decoder.layout.messages["count"].max())
        return cls(
            layout.rows,
            layout.messages,
            layout.fields,
            decoder.counters,
            decoder.message_times,
            decoder.tally,
            decoder.latest,
            decoder.latest_times,
            np.empty(room, np.int64),
            np.empty(room, np.int64),
            np.empty(room),
        )


@compiled
def _follow(c: Any, signals: Any, values: Any, steering: Steering, changes: Any) -> None:
    """Apply the decoded samples of commands. Changed control bits are added to ``changes``.

    A set-point takes effect while the bench is ACTIVE and the axis is in the mode of the set-point. NaN means "no
    change". If one set-point is out of range, the whole frame is refused, because both sides must move together. The
    first set-point for actuators with closed valves waits for the supervisor, which engages them at their present
    position.
    """
    accepted_from = 0
    for k in range(signals.size):
        row = signals[k]
        if steering.fields[row] > 0 and outside(signals, values, k, steering.fields[row], steering.ranges):
            c.refused += 1
            accepted_from = k + steering.fields[row]
        if k < accepted_from:
            continue
        target = steering.targets[row]
        if row == _CONTROL_ROW:
            bits = 0
            for bit in range(_CONTROL_BITS):
                bits |= (values[k + bit] != 0.0) << bit
            c.command_tick = c.tick
            c.late = 0
            c.lost = 0
            if bits != c.bits:
                changes[c.changed] = bits
                c.changed += 1
                c.bits = bits
        elif row == _WIND_ROW:
            if outside(signals, values, k, 1, steering.ranges):
                c.refused += 1
            elif c.active != 0 and not np.isnan(values[k]):
                c.wind_goal = values[k]
                c.wind_slew = SLEW_TICKS
        elif (
            target >= 0
            and c.active != 0
            and (steering.modes[row] < 0 or steering.modes[row] == c.control[target])
            and not np.isnan(values[k])
        ):
            waits = c.engaged == 0 and target <= Target.LATERAL
            if waits:
                c.ordered = 1
            if waits or c.goal[target] != values[k]:
                c.goal[target] = values[k]
                c.slew[target] = SLEW_TICKS


class Incoming(NamedTuple):
    """The input of commands: a ring buffer for received frames, a block for those of one tick, and the decoder."""

    ring: Ring
    block: Block  #: more frames than this in one tick wait for the next
    senders: npt.NDArray[np.int64]
    receiving: Receiving
    steering: Steering
    changes: npt.NDArray[np.int64]  #: the control bits, as they have changed since the supervisor was asked

    @classmethod
    def of(cls, decoder: Decoder) -> "Incoming":
        """Return an empty input with this ``decoder``."""
        room = Receiving.of(decoder, _FRAMES_MAX)
        steering, changes = Steering.of_table(), np.zeros(_FRAMES_MAX, np.int64)
        return cls(
            Ring.of(_WAITING_MAX),
            np.zeros(_FRAMES_MAX, FRAME),
            np.zeros(_FRAMES_MAX, np.int64),
            room,
            steering,
            changes,
        )


@compiled
def _prove(c: Any, block: Any, sender: int, published: Any) -> None:
    """Make ``sender`` the commander if a Control message in its ``block`` carries the token.

    Before this, only the holder of the lease knows the token, from its Modbus connection. Afterwards every client of
    the bus can read the token, but it is valid for this sender only.
    """
    for k in range(block.size):
        record = block[k]
        if record.id != _CONTROL_IDENTIFIER or record.extended != 0 or record.length != LENGTH_MAX:
            continue
        if crc8(record["data"], _CONTROL_DATA_ID) != record["data"][0]:
            continue
        token = np.int64(data_word(record) >> np.uint64(_TOKEN_BIT) & np.uint64(0xFFFF))
        if _may_prove(c, sender, token):
            c.commander = sender
            published[_LEASE_ROW] = token
            return


@compiled
def _may_prove(c: Any, sender: int, token: int) -> bool:
    """Return whether ``token`` makes ``sender`` the commander. A wrong token is counted for this sender. After
    ``TRIES_MAX`` wrong tokens, no token of this sender is accepted.

    If frames have no sender (0), wrong tokens are not counted, because it is unknown which client sent them.
    """
    if sender == 0:
        return bool(token == c.token)
    place = 0
    while place < c.suspects.size and c.suspects[place] != sender and c.suspects[place] != 0:
        place += 1
    if place == c.suspects.size or c.tries[place] >= TRIES_MAX:
        return False
    if token == c.token:
        return True
    if token != NOBODY:
        c.suspects[place] = sender
        c.tries[place] += 1
    return False


@compiled
def take_waiting(c: Any, incoming: Incoming, published: Any) -> int:
    """Process the frames received since the last tick. Return `Happened.COMMANDED` if the supervisor must decide on
    them.

    Counts of refused frames are written to ``published`` (SI by table row). The caller must hold the mutex.
    """
    count = take(incoming.ring, incoming.block, incoming.senders)
    first = 0
    while first < count:
        last = first + 1
        while last < count and incoming.senders[last] == incoming.senders[first]:
            last += 1
        _take_block(c, incoming.block[first:last], incoming.senders[first], incoming, published)
        first = last
    waits = c.changed > 0 or c.asked != 0 or c.ordered != 0
    return Happened.COMMANDED.value if waits else Happened.NOTHING.value


@compiled
def _take_block(c: Any, block: Any, sender: int, incoming: Incoming, published: Any) -> None:
    """Process frames from one ``sender`` (`peers.sender_of`), with the tick as their time stamp.

    Only frames from the commander's connection and with its token have an effect, and requests for the lease.
    """
    if c.token != 0 and c.commander < 0:
        _prove(c, block, sender, published)
    receiving = incoming.receiving
    tally = receiving.tally
    for k in range(block.size):
        block[k].time = c.tick * TICK_NS
    received = c.token != 0 and c.commander == sender
    strangers = tally[Tally.STRANGE]
    count = decode_into(
        block,
        receiving.rows,
        receiving.messages,
        receiving.fields,
        c.token if received else NOBODY,
        receiving.counters,
        receiving.times,
        tally,
        receiving.latest,
        receiving.latest_times,
        receiving.sample_times,
        receiving.sample_signals,
        receiving.sample_values,
    )
    if tally[Tally.STRANGE] != strangers:
        published[_STRANGERS_ROW] += tally[Tally.STRANGE] - strangers
        published[_STRANGER_ROW] = sender & PORT_MASK
        published[_IDENTIFIER_ROW] = tally[Tally.STRANGE_IDENTIFIER]
    published[_REJECTED_ROW] = tally[Tally.CORRUPT] + tally[Tally.REPEATED] + tally[Tally.OUT_OF_SEQUENCE]
    signals, values = receiving.sample_signals[:count], receiving.sample_values[:count]
    for k in range(count):
        # If several clients request in one tick, the holder is answered, or else the first.
        if signals[k] == _NONCE_ROW and (c.asked == 0 or (received and c.asked_sender != sender)):
            c.asked = 1
            c.asked_sender = sender
            c.asked_nonce = np.int64(values[k])
            c.asked_token = np.int64(values[k + 1])
    _follow(c, signals, values, incoming.steering, incoming.changes)
