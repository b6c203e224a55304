"""A stranger's rig on CAN: cantools and autosar-e2e code for it, and it knows nothing of ours."""

from collections.abc import Callable
from functools import reduce
from operator import xor
from pathlib import Path

import cantools
import e2e.p01

from bench_protocol.clock import VirtualClock
from bench_protocol.frames import Block, frame, join, payload
from drivers.memory import InMemoryCan

MS = 1_000_000
DBC = """VERSION ""
NS_ :
BS_:
BU_: RIG HOST

BO_ 2566852609 Heights: 8 RIG
 SG_ Left : 7|16@0+ (0.01,-300) [-300|355.35] "mm" HOST
 SG_ Right : 20|12@0- (0.1,0) [-204.8|204.7] "mm" HOST
 SG_ Alive : 51|4@0+ (1,0) [0|15] "" HOST
 SG_ Crc : 63|8@0+ (1,0) [0|255] "" HOST

BO_ 513 Air: 8 RIG
 SG_ Place M : 0|4@1+ (1,0) [0|15] "" HOST
 SG_ Bellows m0 : 8|16@1+ (0.05,0) [0|3276.75] "kPa" HOST
 SG_ Chamber m1 : 8|16@1+ (0.05,0) [0|3276.75] "kPa" HOST
 SG_ Rate m1 : 32|32@1- (1,0) [0|0] "kPa/s" HOST

BO_ 514 Echo: 8 RIG
 SG_ Target : 0|16@1- (0.5,0) [0|0] "" HOST
 SG_ Mode : 16|8@1+ (1,0) [0|0] "" HOST
 SG_ Stream : 24|16@1- (0.5,0) [0|0] "" HOST

BO_ 769 Set: 8 HOST
 SG_ Crc : 0|8@1+ (1,0) [0|0] "" RIG
 SG_ Alive : 8|4@1+ (1,0) [0|0] "" RIG
 SG_ Target : 16|16@1- (0.5,0) [-1000|1000] "" RIG
 SG_ Mode : 32|8@1+ (1,0) [0|0] "" RIG

BO_ 770 Stream: 8 HOST
 SG_ Value : 0|16@1- (0.5,0) [0|0] "" RIG
 SG_ Spare : 16|8@1+ (1,0) [0|0] "" RIG
 SG_ Alive : 24|2@1+ (1,0) [0|0] "" RIG

BO_ 771 Pages: 8 HOST
 SG_ Index M : 0|8@1+ (1,0) [0|0] "" RIG
 SG_ First m1 : 8|16@1+ (1,0) [0|0] "" RIG
 SG_ Second m2 : 8|16@1+ (1,0) [0|0] "" RIG
 SG_ Third m2 : 24|8@1+ (1,0) [0|0] "" RIG

BO_ 772 Heart: 1 HOST
 SG_ Alive : 0|8@1+ (1,0) [0|0] "" RIG

SIG_VALTYPE_ 513 Rate : 1;
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 2566852609 10;
BA_ "GenMsgCycleTime" BO_ 513 10;
"""
DATABASE = cantools.database.load_string(DBC)

BUS = {
    "kind": "can",
    "interface": "virtual",
    "channel": "to be chosen",
    "dbc": "rig.dbc",
    "messages": {
        "Heights": {
            "counter": "Alive",
            "checksum": {"signal": "Crc", "scheme": "xor8", "start": 0xA5, "identifier": True},
        },
        "Echo": {"stale": "200 ms"},
        "Set": {"counter": "Alive", "checksum": {"signal": "Crc", "scheme": "e2e_p1", "data_id": 0x1234}},
        "Stream": {"every": "20 ms", "counter": "Alive", "values": {"Spare": 7}},
        "Heart": {"every": "50 ms", "counter": "Alive"},
    },
    "points": {"Heights.Right": {"null": -2048}},
}  # fmt: skip


def xor_of(identifier: int, data: bytes) -> int:
    """The rig's own checksum, over all but its last byte."""
    return reduce(xor, identifier.to_bytes(4, "big") + data[:7], 0xA5)


class FarEnd:
    """The rig: cantools codes, autosar-e2e checks commands, and commands come back as an echo."""

    def __init__(self) -> None:
        self.left, self.right_raw, self.bellows, self.rate = 12.34, -2048, 500.0, -1.5
        self.echo = {"Target": 0.0, "Mode": 0, "Stream": 0.0}
        self.cycle = 0
        self.received: list[tuple[str, dict]] = []
        self.bad: list[bytes] = []

    def frames(self) -> Block:
        """All that goes out in one cycle of 10 ms."""
        self.cycle += 1
        heights = DATABASE.get_message_by_name("Heights")
        raw = {
            "Left": round((self.left + 300) / 0.01),
            "Right": self.right_raw,
            "Alive": self.cycle % 16,
            "Crc": 0,
        }
        data = bytearray(heights.encode(raw, scaling=False))
        data[7] = xor_of(heights.frame_id, data)
        air = {"Place": 0, "Bellows": self.bellows}
        if self.cycle % 2:
            air = {"Place": 1, "Chamber": 2 * self.bellows, "Rate": self.rate}
        return join(
            [
                frame(heights.frame_id, bytes(data), extended=True),
                frame(513, DATABASE.encode_message("Air", air)),
                frame(514, DATABASE.encode_message("Echo", self.echo)),
                frame(0x7FF, b"\1\2\3"),  # a third-party frame
            ]
        )

    def receive(self, block: Block) -> None:
        for record in block:
            message = DATABASE.get_message_by_frame_id(int(record["id"]))
            data = payload(record)
            if message.name == "Set" and not e2e.p01.e2e_p01_check(bytearray(data), 0x1234):
                self.bad.append(data)
                continue
            values = message.decode(data)
            self.received.append((message.name, values))
            if message.name == "Set":
                self.echo.update(Target=values["Target"], Mode=values["Mode"])
            elif message.name == "Stream":
                self.echo["Stream"] = values["Value"]


class InMemory:
    """A far end in virtual time."""

    def __init__(self) -> None:
        self.clock, self.far, self.silent = VirtualClock(), FarEnd(), False
        self.ports: list[InMemoryCan] = []
        self.clock.attach(self._advance)
        self._time = 0
        self.change: Callable[[Block], Block] = lambda block: block

    def _advance(self, until: int) -> None:
        while self._time + 10 * MS <= until:
            self._time += 10 * MS
            block = self.change(self.far.frames())
            block["time"] = self._time
            if self.ports and not self.silent:
                self.ports[-1].receive(block)

    def port(self) -> InMemoryCan:
        self.ports.append(InMemoryCan(self.far.receive))
        return self.ports[-1]

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + round(seconds * 1e9))


def write_files(directory: Path) -> Path:
    """Write what the description of this rig names."""
    (directory / "rig.dbc").write_text(DBC)
    (directory / "own.py").write_text(
        "def weighted(identifier, data):\n    return sum(k * byte for k, byte in enumerate(data, 1)) % 251\n"
    )
    return directory
