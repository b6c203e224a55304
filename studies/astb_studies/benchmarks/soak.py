"""``make soak``: a rig at its full rate for half an hour, with commands, clients, and simulated faults.

python -m astb_studies.benchmarks.soak [--minutes 30]
    ends with 1 if memory grew, a sample is missing, or a reading is wrong
"""

import argparse
import contextlib
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from bench_protocol.can_codec import Decoder, Tally
from bench_protocol.clock import RealClock
from bench_protocol.frames import Block
from bench_protocol.rates import FAST_RATE
from bench_protocol.table import TABLE
from bench_protocol.units import mm, s
from bench_sim.rig.control_socket import ask, control_path
from drivers.bench import Bench
from drivers.can_port import open_can
from drivers.errors import BenchError
from drivers.modbus_port import open_modbus
from drivers.wiring.astb.modbus import AstbRegisters
from drivers.wiring.own import own_wiring

POLLERS: Final = 4
POLL: Final = 0.05  # s
#: The faults, which take turns, with their period and duration: one of the plant, two of the bus.
FAULTS: Final = (("leak", {"side": "left"}), ("duplicate", {}), ("drop", {}))
FAULT_PERIOD, FAULT_LASTS = 20.0, 5.0  # s
#: Missing samples in this time around a fault of the bus are attributed to the fault.
SETTLING: Final = 1.0  # s
#: Largest permitted growth of a process after the first half minute (bytes).
GROWTH_MAX: Final = 10e6
SIGNAL: Final = "left.height"
_RIG: Final = 'name = "soak"\n[simulation]\nseed = 1\n'


class Witness:
    """Receives every frame: counts missing frames while the bus is sound, and stores the last seconds of a signal."""

    def __init__(self) -> None:
        self._decoder = Decoder(TABLE, from_rig=True)
        self.samples = self.missing = 0
        self.recent: deque[float] = deque(maxlen=int(4 * FAST_RATE))
        #: When the bus was last broken (monotonic, s).
        self.broken = -np.inf
        self.late_ticks = 0.0

    def receive(self, block: Block) -> None:
        """Take frames."""
        before = int(self._decoder.tally[Tally.LOST])
        samples = self._decoder.decode(block)
        if time.monotonic() - self.broken > SETTLING:
            self.missing += int(self._decoder.tally[Tally.LOST]) - before
        values = samples.values[samples.signals == TABLE.index[SIGNAL]]
        self.samples += values.size
        self.recent.extend(values.tolist())
        self.late_ticks = float(self._decoder.latest[TABLE.index["rig.late_ticks"]])


@dataclass
class Soak:
    """Observations of the soak test."""

    witness: Witness = field(default_factory=Witness)
    readings: int = 0
    wrong: list[str] = field(default_factory=list)
    stops: list[str] = field(default_factory=list)  #: why the bench had to be armed again
    faults: int = 0
    stop: threading.Event = field(default_factory=threading.Event)

    def poll(self, port: int) -> None:
        """Read all signals over Modbus, and compare one with its latest samples on CAN."""
        modbus = open_modbus("127.0.0.1", port, timeout=2.0)
        registers, step = AstbRegisters(TABLE, modbus), TABLE[SIGNAL].step
        while not self.stop.wait(POLL):
            value = registers.snapshot()[SIGNAL]
            time.sleep(0.1)  # the frame of the same sample may still be on its way
            if time.monotonic() - self.witness.broken < SETTLING + 1.0:
                continue
            self.readings += 1
            if not any(abs(value - received) <= 0.51 * step for received in list(self.witness.recent)):
                self.wrong.append(f"{SIGNAL} read as {TABLE[SIGNAL].show(value)}, which never came on CAN")
        modbus.close()

    def command(self, bench: Bench) -> None:
        """Move up and down, without end; arm again whenever the bench has stopped."""
        while not self.stop.is_set():
            try:
                bench.arm()
                bench.vertical.move_to(-30 * mm, -30 * mm, rate=20 * mm / s)
                while not self.stop.is_set():
                    for height in (-20 * mm, -30 * mm):
                        bench.vertical.move_to(height, height, rate=20 * mm / s)
            except BenchError as reason:
                if not self.stop.is_set():
                    self.stops.append(str(reason))
                    time.sleep(1.0)

    def break_and_mend(self, port: int) -> None:
        """Switch one fault after the other on for a while."""
        path = control_path("127.0.0.1", port)
        for turn in range(1_000_000):
            if self.stop.wait(FAULT_PERIOD - FAULT_LASTS):
                return
            (name, values), end = FAULTS[turn % len(FAULTS)], time.monotonic() + FAULT_LASTS
            self._note(name)
            answer = msgspec.json.decode(
                ask(path, msgspec.json.encode({"do": "on", "name": name, "values": values}))
            )
            if "error" in answer:
                self.wrong.append(f"{name}: {answer['error']}")
            while time.monotonic() < end and not self.stop.wait(0.05):
                self._note(name)
            ask(path, msgspec.json.encode({"do": "off", "name": name}))
            self._note(name)
            self.faults += 1

    def _note(self, name: str) -> None:
        """Ignore missing frames during a fault of the bus."""
        if name != "leak":
            self.witness.broken = time.monotonic()


def memory(pid: int) -> float:
    """Return the resident memory of a process (bytes)."""
    return 4096.0 * int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])


@contextlib.contextmanager
def running_rig() -> Iterator[tuple[int, int, int]]:
    """Run a rig; yield its process id and the ports of CAN and Modbus."""
    with tempfile.TemporaryDirectory() as directory:
        file = Path(directory) / "rig.toml"
        file.write_text(_RIG)
        command = [sys.executable, "-m", "astb", "rig", "--rig", str(file), "--can", "tcp"]
        command += ["--can-port", "0", "--modbus-port", "0"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as rig:
            try:
                assert rig.stdout
                parts = dict(part.split("=", 1) for part in rig.stdout.readline().split()[1:])
                can, modbus = (int(parts[port].rpartition(":")[2]) for port in ("can", "modbus"))
                yield rig.pid, can, modbus
            finally:
                rig.kill()


def soak(minutes: float) -> tuple[Soak, list[float]]:
    """Run the soak test; return its observations, and the rig's memory every ten seconds (bytes)."""
    seen, clock = Soak(), RealClock()
    sizes: list[float] = []
    with contextlib.ExitStack() as stack:
        pid, can, modbus = stack.enter_context(running_rig())
        listener: Any = open_can("tcp", port=can)
        stack.callback(listener.close)
        listener.subscribe(seen.witness.receive)
        port = open_modbus("127.0.0.1", modbus, timeout=2.0)
        bench = Bench(own_wiring(open_can("tcp", port=can), port), clock)
        bench.connect(within=10 * s)
        tasks = [(seen.poll, modbus)] * POLLERS + [(seen.command, bench), (seen.break_and_mend, modbus)]
        threads = [threading.Thread(target=task, args=(given,), daemon=True) for task, given in tasks]
        for thread in threads:
            thread.start()
        end = time.monotonic() + 60 * minutes
        while time.monotonic() < end:
            time.sleep(min(10.0, max(0.0, end - time.monotonic())))
            sizes.append(memory(pid))
        seen.stop.set()
        for thread in threads:
            thread.join(10.0)
        with contextlib.suppress(BenchError):
            bench.close()
    return seen, sizes


def judged(seen: Soak, sizes: list[float]) -> list[str]:
    """Return the errors as text."""
    found = seen.wrong[:5]
    if seen.witness.missing:
        found.append(f"{seen.witness.missing} samples are missing while the bus was sound")
    if len(sizes) > 3 and (grown := sizes[-1] - sizes[3]) > GROWTH_MAX:
        found.append(f"the rig's memory grew by {grown / 1e6:.1f} MB")
    if not (seen.readings and seen.witness.samples):
        found.append("nothing was read")
    return found


def main() -> int:
    """Run the soak test and print its observations; return 1 if there is an error."""
    parser = argparse.ArgumentParser(description="Run a rig at its full rate, with faults on and off.")
    parser.add_argument("--minutes", type=float, default=30.0)
    seconds = 60 * (minutes := parser.parse_args().minutes)
    seen, sizes = soak(minutes)
    rate = seen.witness.samples / seconds
    print(
        f"{minutes:g} min: {seen.witness.samples:,} samples ({rate:.1f} a second), {seen.witness.missing} missing; "
        f"{seen.readings:,} readings compared, {len(seen.wrong)} wrong; {seen.faults} faults on and off; "
        f"{seen.witness.late_ticks:.0f} late ticks; memory {sizes[0] / 1e6:.0f} to {sizes[-1] / 1e6:.0f} MB; "
        f"armed again {len(seen.stops)} times"
    )
    for reason in dict.fromkeys(seen.stops):
        print(f"  stopped: {reason}")
    for complaint in (found := judged(seen, sizes)):
        print(f"  WRONG: {complaint}")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
