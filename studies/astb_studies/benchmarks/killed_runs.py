"""Kills runs at random moments by SIGKILL, over real sockets, and inspects their records for lost samples.

python -m astb_studies.benchmarks.killed_runs --count 100
"""

import argparse
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np

from astb_studies.benchmarks.soak import running_rig
from bench_protocol.can_codec import Decoder
from bench_protocol.clock import RealClock
from bench_protocol.frames import Block
from bench_protocol.table import TABLE
from bench_protocol.units import ms, s
from bench_records.exchange import write_csv
from bench_records.index import RunIndex
from bench_records.layout import RESULT, RecordError
from bench_records.record import read
from bench_records.report import report_page
from bench_records.run_folder import SIGNS, open_run
from drivers.bench import Bench
from drivers.can_port import open_can
from drivers.errors import BenchError
from drivers.modbus_port import open_modbus
from drivers.wiring.own import own_wiring
from test_plans.discovery import plans
from test_plans.plan import Plan

#: Largest permitted loss by a kill (s).
ALLOWED: Final = 1.0
PLAN: Final = "lateral_stiffness"
SETTINGS: Final = {"amplitude": "7 mm"}
OPERATOR: Final = "A. Tester"
#: Range of the delay of the kill after the first file or after Ctrl-C (s), for each stage of a run.
MOMENTS: Final = {"beginning": (0.0, 0.1), "under way": (0.0, 12.0), "ending": (0.0, 6.0)}

_TICK: Final = TABLE.index["rig.tick"]
_RIG: Final = 'name = "killed"\nlike = "hall"\n[can]\nbus = "tcp"\nport = {can}\n[modbus]\nport = {modbus}\n'
_ASTB_RUN: Final = (sys.executable, "-m", "astb", "run")
_PATIENCE: Final = 90.0  # s, for a process to come up
_PHASE: Final = re.compile(r"^ *(\d+\.\d) s  +(.+)$", re.MULTILINE)


@dataclass
class Killed:
    """One run: the moment of the kill, the lost time (s), its state in the list of runs, and errors."""

    when: str
    moment: float
    lost: float = np.nan
    listed: str = ""
    wrong: list[str] = field(default_factory=list)


@dataclass
class Bystander:
    """Another client on the bus, which receives the rig's time."""

    tick: float = np.nan
    _decoder: Decoder = field(default_factory=lambda: Decoder(TABLE))

    def receive(self, block: Block) -> None:
        """Decode a block from the bus."""
        self._decoder.decode(block)
        self.tick = float(self._decoder.latest[_TICK])


class Killer:
    """A rig, and runs on it that are killed one after the other; use `killer`."""

    def __init__(self, can: int, modbus: int, directory: Path, bystander: Bystander) -> None:
        self._ports, self._bystander = (can, modbus), bystander
        self._directory, self._runs = directory, directory / "runs"
        self._numbers = count()
        self._file = directory / "rig.toml"
        self._file.write_text(_RIG.format(can=can, modbus=modbus))

    def kill(self, when: str, moment: float) -> Killed:
        """Start a run, kill it ``moment`` seconds after the start of its stage ``when``, and inspect its files."""
        found = Killed(when, moment)
        out = self._runs / str(next(self._numbers))
        folder = out / PLAN
        command = [*_ASTB_RUN, PLAN, "--rig", str(self._file), "--out", str(out), "--operator", OPERATOR]
        command += [f"--set={name}={value}" for name, value in SETTINGS.items()]
        with (self._directory / "output.txt").open("w+") as output:
            with subprocess.Popen(command, stdout=output, stderr=output) as process:
                try:
                    self._wait_for(folder, process)
                    began = self._bystander.tick
                    if when == "ending":
                        time.sleep(1.0)
                        process.send_signal(signal.SIGINT)
                    with suppress(subprocess.TimeoutExpired):
                        process.wait(moment)
                finally:
                    process.kill()
                    end = self._bystander.tick
            output.seek(0)
            self._judge(found, folder, output.read(), began, end)
        self._bring_to_rest()
        return found

    def _wait_for(self, folder: Path, process: "subprocess.Popen[bytes]") -> None:
        """Wait until the run has its first file."""
        deadline = time.monotonic() + _PATIENCE
        while time.monotonic() < deadline and process.poll() is None:
            with suppress(FileNotFoundError):
                if any(folder.iterdir()):
                    return
            time.sleep(0.5 * ms)
        raise RuntimeError(f"no run was started: {(self._directory / 'output.txt').read_text()}")

    def _judge(self, found: Killed, folder: Path, output: str, began: float, end: float) -> None:
        if not any(
            (folder / sign).exists() for sign in SIGNS
        ):  # its head was not whole yet, and nothing moved
            found.listed, found.lost = "not begun", (end - began) * ms
            return
        listed = {one.directory: one.verdict for one in RunIndex(self._runs).runs()}
        found.listed = listed.get(str(folder.relative_to(self._runs)), "not at all")
        expected = "blocked" if (folder / RESULT).exists() else "interrupted"
        if found.listed != expected:
            found.wrong.append(f"listed as {found.listed}, not as {expected}")
        try:
            record, run = read(folder), open_run(folder)
            ticks = record.series("rig.tick")[1]
            if found.listed == "interrupted" and "recovered" in record.meta:
                found.lost = (end - (ticks[-1] if ticks.size else began)) * ms
            else:
                found.lost = 0.0  # the record was closed before
            found.wrong += _differences(run, _expected())
            found.wrong += _missing_phases(
                record, output, end * ms - ALLOWED - (ticks[0] if ticks.size else end) * ms
            )
            if len(record):
                write_csv(record, self._directory / "record.csv", 10.0, ["left.height"])
            if run.result.title not in report_page(folder):
                found.wrong.append("the report does not show the title")
        except RecordError as error:
            found.wrong.append(str(error))
        if not found.lost <= ALLOWED:
            found.wrong.append(f"{found.lost:.3f} s are lost")

    def _bring_to_rest(self) -> None:
        """Reset the rig, which holds after the loss of its commander."""
        can, modbus = self._ports
        clock = RealClock()
        bench = Bench(own_wiring(open_can("tcp", port=can), open_modbus("127.0.0.1", modbus)), clock)
        try:
            bench.connect(within=10 * s)
            bench.reset()
        except BenchError as error:
            print(f"  the rig was not reset: {error}", file=sys.stderr)
        finally:
            bench.close()


def _expected() -> Plan:
    return plans()[PLAN].given(SETTINGS)


def _differences(run: Any, plan: Plan) -> list[str]:
    pairs = {
        "plan": (run.result.plan, plan.name),
        "title": (run.result.title, plan.title),
        "instruction": (run.result.instruction, plan.instruction),
        "parameters": (run.result.parameters, plan.written),
        "operator": (run.facts.get("operator"), OPERATOR),
        "rig": (run.facts.get("rig"), "killed"),
    }
    wrong = [f"{name} is {got!r}" for name, (got, expected) in pairs.items() if got != expected]
    if run.result.specimen is None or not run.result.specimen.serial_number:
        wrong.append("the specimen is unknown")
    return wrong


def _missing_phases(record: Any, output: str, until: float) -> list[str]:
    """Return which phases were shown before ``until`` (s) and are not in the record."""
    shown = Counter(name for at, name in _PHASE.findall(output) if float(at) < until)
    missing = shown - Counter(phase.name for phase in record.phases)
    return [f"the phase {name!r} is missing" for name in missing]


@contextmanager
def killer() -> Iterator[Killer]:
    """Run a rig with a second client on its bus during the block."""
    with running_rig() as (_, can, modbus), tempfile.TemporaryDirectory() as directory:
        bystander, listener = Bystander(), open_can("tcp", port=can)
        listener.subscribe(bystander.receive)
        try:
            yield Killer(can, modbus, Path(directory), bystander)
        finally:
            listener.close()


def main() -> int:
    """Kill runs and print their losses; return 1 if a loss is too large or a record has an error."""
    parser = argparse.ArgumentParser(description="Kill runs at random moments and inspect their records.")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    draw = random.Random(arguments.seed)
    found: list[Killed] = []
    with killer() as kills:
        for number in range(arguments.count):
            when = list(MOMENTS)[number % len(MOMENTS)]
            one = kills.kill(when, draw.uniform(*MOMENTS[when]))
            found.append(one)
            errors = "; ".join(one.wrong) or "correct"
            seen = f"{one.when}, {one.moment:.3f} s: {one.listed}, {one.lost:.3f} s lost, {errors}"
            print(f"{number + 1:4} {seen}", flush=True)
    good = sum(not one.wrong for one in found)
    lost = np.array([one.lost for one in found if one.listed == "interrupted"])
    kinds = ", ".join(f"{number} {name}" for name, number in Counter(one.listed for one in found).items())
    print(f"{good} of {len(found)} are correct: {kinds}")
    if lost.size:
        print(f"lost end of interrupted runs: median {np.median(lost):.3f} s, maximum {lost.max():.3f} s")
    return int(good < len(found))


if __name__ == "__main__":
    sys.exit(main())
