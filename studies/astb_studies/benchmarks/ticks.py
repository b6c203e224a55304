"""A rig in real time for a benchmark, and its own counters of tick lateness."""

import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from socket import create_server
from typing import Final, NamedTuple

from astb_studies.benchmarks.measure import child
from bench_protocol.rates import LATENESS_BINS
from bench_protocol.table import TABLE
from drivers.modbus_port import ModbusPort, open_modbus
from drivers.wiring.astb.modbus import AstbRegisters

_TAIL: Final = tuple(one.signal for one in LATENESS_BINS if one.edge > 250e-6)


class Lateness(NamedTuple):
    """Tick lateness of a period: the number of ticks late by ≥ 1 ms, and of 1000 ticks the number late by ≥ 250 µs."""

    late: float
    tail: float


#: Their names on the page.
CALLED: Final = ("ticks late by 1 ms or more", "of 1000 ticks, late by 250 µs or more")


@contextmanager
def rig_of_its_own(serving: Sequence[str] = ("astb", "rig")) -> Iterator[tuple[Path, ModbusPort]]:
    """Run a rig on free ports; yield its rig file, in a separate folder, and its Modbus port.

    The module ``serving`` with its arguments is the rig.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        with create_server(("127.0.0.1", 0)) as can, create_server(("127.0.0.1", 0)) as modbus:
            ports = can.getsockname()[1], modbus.getsockname()[1]
        file = folder / "rig.toml"
        file.write_text(
            f'name = "measured"\n[can]\nbus = "tcp"\nport = {ports[0]}\n[modbus]\nport = {ports[1]}\n[simulation]\n'
        )
        rig = stack.enter_context(child(sys.executable, "-m", *serving, "--rig", str(file)))
        assert rig.stdout.readline().startswith("ready ")
        port = open_modbus("127.0.0.1", ports[1])
        stack.callback(port.close)
        yield file, port


def lateness_during(modbus: ModbusPort, act: Callable[[], object]) -> Lateness:
    """Return the lateness of the rig's ticks during the call of ``act``."""
    before = _counts(modbus)
    act()
    counts = {name: count - before[name] for name, count in _counts(modbus).items()}
    ticks = max(1.0, sum(counts.values()))
    return Lateness(counts[LATENESS_BINS[-1].signal], 1000 * sum(counts[name] for name in _TAIL) / ticks)


def _counts(modbus: ModbusPort) -> dict[str, float]:
    return AstbRegisters(TABLE, modbus).read([one.signal for one in LATENESS_BINS])
