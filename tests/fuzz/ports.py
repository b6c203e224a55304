"""The ports of a running rig under fuzz: batches on sockets, while a witness looks whether the bench goes on."""

import contextlib
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench_protocol.can_codec import Decoder, Tally
from bench_protocol.frames import join
from bench_protocol.table import TABLE
from bench_protocol.words import STATES
from drivers.hub_bus import HubBus
from drivers.modbus_port import open_modbus
from tests.fuzz.decoders import DECODERS
from tests.fuzz.mutator import Mutator, seeds

CONNECTIONS = 4
RIG = 'name = "fuzz"\n[simulation]\nseed = 1\n'
_PATIENCE = 120.0  # s, for a rig to compile and start


@contextlib.contextmanager
def running_rig() -> Iterator[tuple[subprocess.Popen[str], dict[str, int]]]:
    """Run a rig in a separate process; yield it with the numbers of its ports."""
    with tempfile.TemporaryDirectory() as directory, socket.create_server(("127.0.0.1", 0)) as free:
        file, capture = Path(directory) / "rig.toml", free.getsockname()[1]
        file.write_text(RIG)
        free.close()
        command = [sys.executable, "-m", "astb", "rig", "--rig", str(file), "--can", "tcp", "--can-port", "0"]
        command += ["--modbus-port", "0", "--capture-port", str(capture)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as rig:
            try:
                assert rig.stdout
                assert select.select([rig.stdout], [], [], _PATIENCE)[0], "the rig does not start"
                parts = dict(part.split("=", 1) for part in rig.stdout.readline().split()[1:])
                ports = {port: int(parts[port].rpartition(":")[2]) for port in ("can", "modbus")}
                yield rig, ports | {"capture": capture}
            finally:
                rig.kill()


class Port:
    """One port: how a connection begins, its inputs, and how many in one piece.

    What lies behind the input for which a client is sent away is not read: hence pieces of the right size.
    """

    def __init__(self, wire: str, seeds_of: str, batch: int, greeting: bytes = b"") -> None:
        self.wire, self.seeds_of, self.batch, self.greeting = wire, seeds_of, batch, greeting

    def flood(self, port: int, mutator: Mutator, count: int, seconds: float) -> int:
        """Send inputs until ``count`` are sent or the time is over; reconnect when disconnected. Return how many."""
        done, end = 0, time.monotonic() + seconds
        lines: list[socket.socket | None] = [None] * CONNECTIONS
        with contextlib.ExitStack() as stack:
            while done < count and time.monotonic() < end:
                for k in range(CONNECTIONS):
                    line = lines[k] = lines[k] or self._connect(port, stack)
                    data = b"".join(mutator.next() for _ in range(self.batch))
                    try:
                        line.sendall(data)
                        while select.select([line], [], [], 0)[0]:
                            if not line.recv(65536):
                                raise ConnectionResetError
                    except OSError:
                        line.close()
                        lines[k] = None
                    done += self.batch
        return done

    def _connect(self, port: int, stack: contextlib.ExitStack) -> socket.socket:
        line = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=5.0))
        line.sendall(self.greeting)
        return line


PORTS = {
    "can-port": Port("can", "socketcand", 80, b"< open vcan0 >< rawmode >"),
    "modbus-port": Port("modbus", "modbus", 4),
    "capture-port": Port("capture", "socketcand", 400),
}
assert {port.seeds_of for port in PORTS.values()} <= {make.name for make in DECODERS}


def flood(name: str, count: int, seed: int, minutes: float) -> str:
    """Return what became of a rig one of whose ports was sent ``count`` inputs."""
    port = PORTS[name]
    with running_rig() as (rig, ports):
        before = _memory(rig.pid)
        start = time.monotonic()
        mutator = Mutator(seeds(port.seeds_of), seed, text=port.seeds_of == "socketcand")
        done = port.flood(ports[port.wire], mutator, count, 60 * minutes)
        took = time.monotonic() - start
        time.sleep(1.0)
        grown = _memory(rig.pid) - before
        wrong = _complaints(rig, ports)
        if grown > 100e6:
            wrong.append(f"its memory grew by {grown / 1e6:.0f} MB")
    said = "; ".join(wrong) if wrong else f"nothing found, memory {grown / 1e6:+.0f} MB"
    return f"{'FAILED, ' if wrong else ''}{done:,} inputs in {took:.0f} s: {said}"


def _complaints(rig: subprocess.Popen[str], ports: dict[str, int]) -> list[str]:
    """Return the faults of a rig without commands: it sends every sample, answers, and stays in place."""
    if rig.poll() is not None:
        assert rig.stderr
        return [f"the rig has ended: {rig.stderr.read()}"]
    wrong = []
    with HubBus(port=ports["can"]) as bus:
        parts, end = [], time.monotonic() + 2.0
        while time.monotonic() < end:
            parts.append(bus.recv_block(0.1))
    decoder = Decoder(TABLE, from_rig=True)
    samples = decoder.decode(join(parts))
    if lost := int(decoder.tally[Tally.LOST]):
        wrong.append(f"{lost} samples are missing")
    if (count := int((samples.signals == TABLE.index["left.height"]).sum())) < 300:
        wrong.append(f"{count} samples in 2 s, 400 are right")
    states = {STATES[int(code)] for code in samples.values[samples.signals == TABLE.index["rig.state"]]}
    if not states <= {"DISABLED", "OFF", "BOOT", "INIT"}:
        wrong.append(f"somebody without a lease has brought it to {states}")
    modbus: Any = open_modbus("127.0.0.1", ports["modbus"], timeout=2.0)
    if modbus.identification()[0x80] != f"{TABLE.map_hash:08x}".encode():
        wrong.append("it does not know its map any more")
    modbus.close()
    return wrong


def _memory(pid: int) -> float:
    """Return the resident memory of a process (bytes)."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096.0
