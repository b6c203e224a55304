"""CANopen node of the rig, independent of the bus: boot-up, NMT, heartbeats, SYNC, and an SDO server for its objects.

NMT and SDO frames carry no token. While the lease has a holder, NMT commands are refused and counted. SDO writes are
refused too. The only exception: if the holder writes the token to object 2001h, the next SDO write of its connection is
accepted. Without a holder, NMT and SDO change only the communication of the node, never the motion of the bench. When
the holder changes, the node returns to its state after booting.
"""

from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from bench_protocol.can_codec import Decoder, Encoder
from bench_protocol.canopen import (
    ALL_NODES,
    EVENT_DRIVEN,
    HEARTBEAT_BASE,
    HEARTBEAT_IDENTIFIER,
    NMT_IDENTIFIER,
    NODE,
    NOT_VALID,
    SDO_REQUEST_IDENTIFIER,
    SDO_RESPONSE_IDENTIFIER,
    SYNC_IDENTIFIER,
    SYNC_PRODUCED,
    SYNCHRONOUS_MAX,
    ErrorBehaviour,
    NmtCommand,
    NmtState,
)
from bench_protocol.frames import STANDARD_ID_MAX, Block, frame, payload
from bench_protocol.object_dictionary import (
    ERROR_BEHAVIOUR,
    HEARTBEAT_CONSUMER,
    HEARTBEAT_PRODUCER,
    PDO_COB_ID,
    SYNC_COB_ID,
    SYNC_PERIOD,
    TRANSMISSION_TYPE,
)
from bench_protocol.sdo import SdoServer
from bench_protocol.table import TABLE
from bench_sim.rig.controls import FAST, MEDIUM, SLOW, TICK_NS, Happened
from bench_sim.rig.node_objects import DEFAULTS, TPDOS, NodeHost, NodeObjects, consumed

#: Limits of the work in a tick, so that a client that does not wait for answers, or floods the bus, cannot delay it.
_SDO_PER_TICK: Final = 8
_FRAMES_AT_ONCE: Final = 32
_LEASE_REQUEST: Final = TABLE.messages[TABLE.message_index["LeaseRequest"]].identifier
_NEVER: Final = -1
_TICKS_PER_MS: Final = 1_000_000 // TICK_NS


class CanopenHost(NodeHost, Protocol):
    """The methods of the rig that its node uses."""

    def send(self, block: Block) -> None:
        """Send frames at once, outside of the tick."""

    def heartbeat_lost(self) -> None:
        """Handle the missing heartbeat of the commander."""

    def heartbeat_back(self) -> None:
        """Handle a heartbeat that has returned, or that is no longer expected."""


class CanopenNode:
    """The CANopen node of the rig. ``controls`` are those of the tick.

    ``timed`` has one array for each period: the table rows of the messages that the tick sends. The node sets a row to
    −1 if its message is not to be sent.
    """

    def __init__(
        self,
        host: CanopenHost,
        controls: Any,
        encoder: Encoder,
        decoder: Decoder,
        timed: Sequence[npt.NDArray[np.int64]],
    ) -> None:
        self.objects = NodeObjects(host, encoder, decoder, self._configure)
        self._host, self._controls, self._encoder = host, controls, encoder
        self._timed = [(rows, rows.copy()) for rows in timed]
        self._server = SdoServer(self.objects)
        self._handlers: dict[int, Callable[[bytes], None]] = {
            NMT_IDENTIFIER: self._command,
            SYNC_IDENTIFIER: self._on_sync,
            SDO_REQUEST_IDENTIFIER: self._on_request,
        }
        self._mine = np.zeros(STANDARD_ID_MAX + 1, bool)
        self._mine[list(self._handlers)] = True
        self._guarded: int | None = None  # the identifier of the heartbeat that is expected
        self._syncs = self._sync_sample = self._sync_ticks = 0
        self._answered, self._answer_tick = 0, _NEVER
        self._reset()

    @property
    def operational(self) -> bool:
        """Whether the node is in the state operational, in which it sends and receives PDOs."""
        return int(self._controls["node_state"]) == NmtState.OPERATIONAL

    def start(self) -> None:
        """Restore the state that the node has after booting, without a boot-up message. Called when the holder of the
        bench changes or leaves.
        """
        if not self.operational or self.objects.parameters != DEFAULTS:
            self._restore()

    def concerns(self, block: Block) -> bool:
        """Return whether the node must handle ``block`` before the tick reads the other frames."""
        return not self.operational or bool(self._for_node(block).any())

    def _for_node(self, block: Block) -> npt.NDArray[np.bool_]:
        """Return a mask of the frames that only the node handles."""
        mine = self._mine[block["id"] & STANDARD_ID_MAX] & (block["extended"] == 0)
        return mine & (block["id"] <= STANDARD_ID_MAX)

    def receive(self, block: Block, peer: str) -> Block:
        """Handle the first `_FRAMES_AT_ONCE` frames of ``peer`` that are for the node, count the rest of these as
        dropped, and return the other frames. If the node is not operational, only requests for the lease are returned,
        and the other frames are counted as refused.
        """
        self.objects.peer = peer
        mine = self._for_node(block)
        own, block = block[mine], block[~mine]
        for record in own[:_FRAMES_AT_ONCE]:
            identifier, data = int(record["id"]), payload(record)
            self._handlers.get(identifier, self._on_heartbeat)(data)
        self.objects.refused[3] += max(0, own.size - _FRAMES_AT_ONCE)
        if self.operational:
            return block
        asks = block["id"] == _LEASE_REQUEST  # kept, because a new holder starts the node
        self.objects.refused[4] += int(block.size - asks.sum())
        return block[asks]

    def decide(self, happened: Happened) -> None:
        """If the tick reports a due time of the node: handle a missing heartbeat, and send a SYNC that is due."""
        if Happened.NODE not in happened:
            return
        c = self._controls
        if c["tick"] == c["guard_due"]:
            c["guard_due"] = _NEVER
            match self.objects.parameters[ERROR_BEHAVIOUR, 1]:
                case ErrorBehaviour.PRE_OPERATIONAL if self.operational:
                    self._enter(NmtState.PRE_OPERATIONAL)
                case ErrorBehaviour.STOPPED:
                    self._enter(NmtState.STOPPED)
            self._host.heartbeat_lost()
        if c["tick"] == c["sync_due"]:
            c["sync_due"] += self._sync_ticks
            self._send(SYNC_IDENTIFIER, b"")
            self._on_sync(b"")

    # -- NMT -----------------------------------------------------------------------------------------------------

    def _command(self, data: bytes) -> None:
        if len(data) != 2 or data[1] not in (ALL_NODES, NODE) or data[0] not in list(NmtCommand):
            return
        if self._host.held:
            self.objects.refused[1] += 1
            self._host.refuse(self.objects.peer, NMT_IDENTIFIER)
            return
        match NmtCommand(data[0]):
            case NmtCommand.START:
                self._enter(NmtState.OPERATIONAL)
            case NmtCommand.STOP:
                self._enter(NmtState.STOPPED)
            case NmtCommand.ENTER_PRE_OPERATIONAL:
                self._enter(NmtState.PRE_OPERATIONAL)
            case NmtCommand.RESET_NODE:
                self._host.emergencies.history.clear()
                self._reset()
            case NmtCommand.RESET_COMMUNICATION:
                self._reset()

    def _reset(self) -> None:
        """Boot the communication: send the boot-up message, set all parameters to defaults, and start the node."""
        self._send(HEARTBEAT_IDENTIFIER, bytes((NmtState.INITIALISING,)))
        self._restore()

    def _restore(self) -> None:
        self.objects.parameters = dict(DEFAULTS)
        self._server = SdoServer(self.objects)
        self._enter(NmtState.OPERATIONAL)
        self._configure()

    def _enter(self, state: NmtState) -> None:
        self._controls["node_state"] = state
        self._plan()

    def _plan(self) -> None:
        """Select the periodic messages of the tick. Messages that wait for SYNC, or for the start of the node, are
        left out.
        """
        for (rows, all_rows), period in zip(self._timed, (FAST, MEDIUM, SLOW), strict=True):
            timed = [self._transmission_type(row) in EVENT_DRIVEN for row in all_rows.tolist()]
            waited = rows < 0
            rows[:] = np.where(timed, all_rows, -1) if self.operational else -1
            # A counter gives the sampling instant, so it also counts the messages that were not sent.
            self._encoder.counters[rows[waited & (rows >= 0)]] = int(self._controls["tick"]) // period % 256

    def _transmission_type(self, row: int) -> int:
        """Return the transmission type of the TPDO with this message, or 0 if the TPDO is not sent."""
        parameters = self.objects.parameters
        if parameters[TPDOS[row], PDO_COB_ID] & NOT_VALID:
            return 0
        return parameters[TPDOS[row], TRANSMISSION_TYPE]

    def _configure(self) -> None:
        """Apply the node's communication parameters to the tick."""
        c, parameters = self._controls, self.objects.parameters
        self._plan()
        period = parameters[HEARTBEAT_PRODUCER, 0] * _TICKS_PER_MS
        if c["heartbeat"] != period:
            c["heartbeat"], c["heartbeat_due"] = period, c["tick"] + period
        guarded, time = consumed(parameters[HEARTBEAT_CONSUMER, 1])
        expected = HEARTBEAT_BASE + guarded if guarded and time else None
        if expected != self._guarded:
            if self._guarded is not None:
                self._mine[self._guarded] = False
            if expected is not None:
                self._mine[expected] = True
            self._guarded, c["guard_due"] = expected, _NEVER
            self._host.heartbeat_back()
        produced = parameters[SYNC_COB_ID, 0] & SYNC_PRODUCED
        ticks = parameters[SYNC_PERIOD, 0] // 1000 * _TICKS_PER_MS if produced else 0
        if not ticks:
            c["sync_due"] = _NEVER
        elif c["sync_due"] == _NEVER or ticks != self._sync_ticks:
            c["sync_due"] = c["tick"] + ticks
        self._sync_ticks = ticks

    # -- heartbeat, SYNC, SDO ------------------------------------------------------------------------------------

    def _on_heartbeat(self, data: bytes) -> None:
        """Restart the timeout of the heartbeat. The first heartbeat or boot-up message starts the monitoring."""
        if len(data) == 1:
            _, time = consumed(self.objects.parameters[HEARTBEAT_CONSUMER, 1])
            if self._controls["guard_due"] == _NEVER:
                self._host.heartbeat_back()
            self._controls["guard_due"] = self._controls["tick"] + time * _TICKS_PER_MS

    def _on_sync(self, data: bytes) -> None:
        """Send the PDOs of this SYNC. A second SYNC in one sampling period is ignored, because the values would be
        the same.
        """
        del data  # the counter that some producers add
        sample = int(self._controls["tick"]) // FAST
        if not self.operational or sample == self._sync_sample:
            return
        self._sync_sample = sample
        self._syncs += 1
        due = [row for row in TPDOS if self._is_due(self._transmission_type(row))]
        if due:
            rows = np.array(due, np.int64)
            self._host.send(self._encoder.encode(self._host.values, rows, self._now()))

    def _is_due(self, transmission_type: int) -> bool:
        return 1 <= transmission_type <= SYNCHRONOUS_MAX and self._syncs % transmission_type == 0

    def _on_request(self, request: bytes) -> None:
        tick = int(self._controls["tick"])
        if tick != self._answer_tick:
            self._answered, self._answer_tick = 0, tick
        if int(self._controls["node_state"]) == NmtState.STOPPED:
            return
        if self._answered == _SDO_PER_TICK:
            self.objects.refused[3] += 1
            return
        response = self._server.answer(request)
        if response is not None:
            self._answered += 1
            self._send(SDO_RESPONSE_IDENTIFIER, response)

    def _now(self) -> int:
        return int(self._controls["tick"]) * TICK_NS

    def _send(self, identifier: int, data: bytes) -> None:
        self._host.send(frame(identifier, data, self._now()))
