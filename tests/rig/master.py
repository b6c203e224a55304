"""A CANopen master on the rig's bus: it uses only frames and stores all received ones."""

import struct

from bench_protocol.frames import Block, frame, payload
from bench_protocol.table import TABLE
from bench_sim.rig.rig import Rig

NMT, SYNC, EMERGENCY, RESPONSE, REQUEST, HEARTBEAT = 0x000, 0x080, 0x081, 0x581, 0x601, 0x701
START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 1, 2, 128, 129, 130
IDENTIFIERS = {message.name: message.identifier for message in TABLE.messages}
PERIODIC = {message.name for message in TABLE.messages if message.from_rig and message.rate}


def number(data: bytes) -> int:
    return int.from_bytes(data, "little")


class Master:
    """Speaks CANopen to a rig by bytes; keeps everything that it has heard."""

    def __init__(self, rig: Rig, peer: str = "master") -> None:
        self.rig, self.peer = rig, peer
        self.heard: list[tuple[int, int, bytes]] = []

    def wait(self, ticks: int) -> Block:
        block = self.rig.run(ticks)
        self.heard += [(int(one["time"]) // 10**6, int(one["id"]), payload(one)) for one in block]
        return block

    def say(self, identifier: int, data: bytes, ticks: int = 1) -> list[tuple[int, bytes]]:
        """Send a frame; return the frames of the ticks after it, without the times."""
        before = len(self.heard)
        self.rig.receive(frame(identifier, data), self.peer)
        self.wait(ticks)
        return [(identifier, data) for _, identifier, data in self.heard[before:]]

    def nmt(self, command: int, node: int = 1) -> None:
        self.say(NMT, bytes((command, node)))

    def of(self, identifier: int) -> list[tuple[int, bytes]]:
        return [(time, data) for time, one, data in self.heard if one == identifier]

    def ask(self, request: bytes) -> bytes:
        (response,) = [data for identifier, data in self.say(REQUEST, request) if identifier == RESPONSE]
        return response

    def upload(self, index: int, sub: int = 0) -> bytes:
        head = self.ask(struct.pack("<BHB4x", 0x40, index, sub))
        assert head[0] >> 5 == 2, f"abort {head[4:][::-1].hex()}"
        if head[0] & 2:
            return head[4 : 8 - (head[0] >> 2 & 3)]
        data, toggle = b"", 0
        while True:
            segment = self.ask(bytes((0x60 | toggle,)) + bytes(7))
            assert segment[0] & 0x10 == toggle
            data += segment[1 : 8 - (segment[0] >> 1 & 7)]
            toggle ^= 0x10
            if segment[0] & 1:
                return data

    def download(self, index: int, sub: int, value: int, size: int) -> int:
        """Write by an expedited transfer; return the abort code, 0 for success."""
        command = 0x23 | (4 - size) << 2
        data = value.to_bytes(size, "little").ljust(4, b"\0")
        answer = self.ask(struct.pack("<BHB", command, index, sub) + data)
        return 0 if answer[0] == 0x60 else int.from_bytes(answer[4:], "little")

    def abort_code(self, index: int, sub: int = 0) -> int:
        answer = self.ask(struct.pack("<BHB4x", 0x40, index, sub))
        assert answer[0] == 0x80
        return int.from_bytes(answer[4:], "little")

    @property
    def messages(self) -> set[str]:
        """The periodic messages that come within 100 ms."""
        received = set(self.wait(100)["id"].tolist())
        return {name for name in PERIODIC if IDENTIFIERS[name] in received}
