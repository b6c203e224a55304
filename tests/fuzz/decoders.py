"""What reads bytes of strangers, each with what must hold for any input: a failure is an exception of any kind."""

import struct
from collections.abc import Callable, Sequence

import numpy as np

from bench_protocol import modbus, socketcand
from bench_protocol.can_codec import Decoder, Encoder, Tally
from bench_protocol.frames import FRAME, STANDARD_ID_MAX, Block, frame
from bench_protocol.table import TABLE
from bench_sim.parameters import load
from bench_sim.rig.can_bus import RIG
from bench_sim.rig.pace import Pace
from bench_sim.rig.rig import Rig
from tests.fuzz.mutator import seeds

BATCH = 200
_EXCEPTIONS = {1, 2, 3, 4, 6, 0x0B}


class Target:
    """One decoder: valid inputs to begin with, and ``check(inputs)``, which raises if something is wrong."""

    name: str
    text = False

    def valid(self) -> Sequence[bytes]:
        """Return the kept seeds."""
        return seeds(self.name)

    def check(self, inputs: Sequence[bytes]) -> None:
        raise NotImplementedError


def contents(events: Sequence[socketcand.Event]) -> list[object]:
    """Return the contents of events, frame by frame: blocks depend on how the stream was cut."""
    found: list[object] = []
    for event in events:
        if isinstance(event, (socketcand.Received, socketcand.Sent)):
            found += [(type(event), one.tobytes()) for one in event.block]
        else:
            found.append(event)
    return found


class Socketcand(Target):
    """Lines of the socketcand protocol: never raises, however cut the same, and what it understood can be written."""

    name, text = "socketcand", True

    def check(self, inputs: Sequence[bytes]) -> None:
        for data in inputs:
            parser = socketcand.Parser()
            whole = parser.feed(data)
            cut = len(data) // 3
            parts = socketcand.Parser()
            assert contents(parts.feed(data[:cut]) + parts.feed(data[cut:])) == contents(whole)
            for event in whole:
                if isinstance(event, (socketcand.Received, socketcand.Sent)):
                    self._written(event)
            # Whatever came, the next line is understood.
            again = contents(parser.feed(b">< frame 123 1.5 AA >"))
            assert again[-1] == (socketcand.Received, frame(0x123, b"\xaa", 1_500_000_000).tobytes())

    def _written(self, event: socketcand.Received | socketcand.Sent) -> None:
        block = event.block.copy()
        assert (block["length"] <= 8).all()
        assert (block["id"] <= np.where(block["extended"], 0x1FFF_FFFF, STANDARD_ID_MAX)).all()
        if isinstance(event, socketcand.Received):
            block["time"] -= block["time"] % 1000
            data = socketcand.frame_bytes(block)
        else:
            data = socketcand.send_bytes(block)
        (read,) = socketcand.Parser().feed(data)
        assert type(read) is type(event)
        assert read.block.tobytes() == block.tobytes()


class Adus(Target):
    """Requests of Modbus/TCP to the bench's own registers: each gets an answer that belongs to it, or the line ends."""

    name = "modbus"

    def __init__(self) -> None:
        self._rig = Rig(load("astb"), seed=1)
        self._rig.run(10)

    def check(self, inputs: Sequence[bytes]) -> None:
        for data in inputs:
            stream = modbus.AduStream()
            try:
                adus = stream.feed(data)
            except modbus.FramingError:
                adus = []
            for adu in adus:
                self._answered(adu, self._rig.answer(adu, "modbus:127.0.0.1:5"))
        self._rig.run(1)
        assert np.isfinite(self._rig.plant.state).all()

    def _answered(self, adu: bytes, answer: bytes) -> None:
        assert answer[:4] == adu[:4]
        assert struct.unpack(">H", answer[4:6])[0] == len(answer) - 6 <= 254
        assert answer[6] == adu[6]
        if answer[7] & 0x80:
            assert answer[7] == adu[7] | 0x80
            assert answer[8] in _EXCEPTIONS
            assert len(answer) == 9
        else:
            assert answer[7] == adu[7]


def block_of(inputs: Sequence[bytes]) -> Block:
    """Return inputs as frames: the first five bytes are identifier and kind, then length and data."""
    block = np.zeros(len(inputs), FRAME)
    for one, data in zip(block, inputs, strict=True):
        padded = data[:14].ljust(14, b"\0")
        identifier, extended, length, payload = struct.unpack(">IBB8s", padded)
        one["extended"], one["length"] = extended & 1, min(length, 8)
        one["id"] = identifier & (0x1FFF_FFFF if extended & 1 else STANDARD_ID_MAX)
        one["data"][: one["length"]] = np.frombuffer(payload, np.uint8)[: one["length"]]
    return block


class Frames(Target):
    """CAN frames: what a decoder makes of any is in its range or not available, and each is accepted or counted."""

    name = "can"

    def __init__(self) -> None:
        self._decoders = Decoder(TABLE), Decoder(TABLE, from_rig=False), Decoder(TABLE, from_rig=True)
        self._lows = np.array([signal.low for signal in TABLE.signals])
        self._highs = np.array([signal.high for signal in TABLE.signals])

    def valid(self) -> Sequence[bytes]:
        """Return every message of the table as the codec writes it, besides the seeds."""
        encoder = Encoder(TABLE)
        rows = encoder.rows([message.name for message in TABLE.messages])
        found = []
        for value in (0.0, 1.0, np.nan):
            for one in encoder.encode(np.full(len(TABLE.signals), value), rows, 0):
                found.append(
                    struct.pack(">IBB", one["id"], one["extended"], one["length"]) + one["data"].tobytes()
                )
        return [*found, *seeds(self.name)]

    def check(self, inputs: Sequence[bytes]) -> None:
        block = block_of(inputs)
        for decoder in self._decoders:
            before = decoder.tally.copy()
            samples = decoder.decode(block)
            taken = decoder.tally - before
            refused = (Tally.UNKNOWN, Tally.MALFORMED, Tally.CORRUPT, Tally.REPEATED, Tally.OUT_OF_SEQUENCE)
            assert taken[Tally.ACCEPTED] + taken[list(refused)].sum() + taken[Tally.STRANGE] == block.size
            assert not np.isinf(samples.values).any()


class WholeRig(Frames):
    """CAN frames to a bench, SDO, NMT and SYNC among them: it keeps ticking, and only a token moves it."""

    name = "rig"

    def __init__(self) -> None:
        self._rig = Rig(load("astb"), seed=1)
        self._rig.run(500)

    def check(self, inputs: Sequence[bytes]) -> None:
        before = self._rig.state
        self._rig.receive(block_of(inputs), "can:127.0.0.1:5")
        sent = self._rig.run(5)
        assert (np.diff(sent["time"]) >= 0).all()
        assert self._rig.state is before
        assert np.isfinite(self._rig.plant.state).all()


class PacedBus(Frames):
    """CAN frames on a bus that takes its time: as many come out as go in, and in time."""

    name = "pace"

    def __init__(self) -> None:
        self._pace, self._now = Pace(1_000_000, error_rate=0.01), 0

    def check(self, inputs: Sequence[bytes]) -> None:
        block = block_of(inputs)
        block["time"] = self._now
        self._pace.incoming(block, "a", self._now)
        self._now += 2_000_000 + 400_000 * len(inputs)
        out = [part for part, peer in self._pace.due(self._now) if peer != RIG]
        assert sum(part.size for part in out) == block.size
        assert self._pace.waiting == 0


DECODERS: Sequence[Callable[[], Target]] = (Socketcand, Adus, Frames, WholeRig, PacedBus)
