"""`astb rig`: the simulated rig in real time, and the group of commands for rigs."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
from msgspec.structs import replace

from astb.commands.ending import UNAWARES, ended_by
from astb.commands.options import RIG_OPTION, SEED_OPTION, read_rig, simulated, simulation_options
from astb.exit_codes import blocked, misuse
from astb.plugins import CommandGroup
from bench_protocol.rates import TICK_RATE, TICK_RATE_VARIABLE, TICK_RATES
from bench_protocol.runtime import require_linux

if TYPE_CHECKING:
    from astb.rig_file import RigFile, Simulation
    from bench_sim.rig.capture import Capture
    from bench_sim.rig.rig import Rig


#: The modules of the commands below `astb rig`.
HEADINGS: Final = {
    "Commands": {
        "run": "astb.commands.rig",
        "check": "astb.acceptance.commands.check_rig",
        "conform": "astb.acceptance.commands.conform",
        "new": "astb.acceptance.commands.wiring",
        "limits": "astb.commands.lists",
        "signals": "astb.commands.lists",
        "fault": "astb.commands.fault",
    }
}


@click.group("rig", cls=CommandGroup, headings=HEADINGS, path="astb rig", default="run")
def rig_command() -> None:
    """Simulate a rig, check a rig, or describe a new one.

    Without COMMAND, astb rig [OPTIONS] is short for astb rig run [OPTIONS].
    """


@click.command("run")
@RIG_OPTION
@click.option(
    "--can", help="CAN bus: auto, tcp, or a SocketCAN interface such as vcan0.  [default: from the rig file]"
)
@click.option(
    "--can-port",
    type=click.IntRange(0, 65535),
    help="TCP port of the CAN hub, or 0 for any free port.  [default: from the rig file]",
)
@click.option(
    "--modbus-port",
    type=click.IntRange(0, 65535),
    help="TCP port of the Modbus server, or 0 for any free port.  [default: from the rig file]",
)
@SEED_OPTION
@simulation_options
@click.option(
    "--bit-rate",
    metavar="RATE",
    help="Simulate the duration of CAN frames at this bit rate, such as 500k.  [default: from the rig file]",
)
@click.option(
    "--capture",
    type=click.Path(path_type=Path),
    help="Write the bus traffic to this pcapng file or named pipe.",
)
@click.option(
    "--capture-port",
    type=click.IntRange(1, 65535),
    help="Send the bus traffic to this TCP port, for example for `tshark -i TCP@127.0.0.1:19901`.",
)
@click.option(
    "--tick-rate",
    type=click.Choice([str(rate) for rate in TICK_RATES]),
    help=f"Ticks per second.  [default: {TICK_RATE_VARIABLE} of the environment, else {TICK_RATES[0]}]",
)
@click.option(
    "--beacon",
    is_flag=True,
    help="Announce the CAN hub on the loopback interface, so that SavvyCAN finds it.",
)
@click.option(
    "--allow-remote", is_flag=True, help="Accept connections of other machines. The ports have no password."
)
@click.option("--until-eof", is_flag=True, hidden=True)
def run_command(
    rig_named: str | None,
    can: str | None,
    can_port: int | None,
    modbus_port: int | None,
    seed: int | None,
    model: str | None,
    effects: tuple[str, ...],
    sealed: str | None,
    bit_rate: str | None,
    capture: Path | None,
    capture_port: int | None,
    tick_rate: str | None,
    beacon: bool,
    allow_remote: bool,
    until_eof: bool,
) -> None:
    """Run the simulated rig in real time until interrupted.

    It prints `ready can=… modbus=… control=…` when its ports are open; `control` is the socket for `astb rig fault`.
    The signal SIGUSR1 presses the emergency stop, SIGUSR2 releases it.
    """
    require_linux("a rig in real time")
    _at_tick_rate(tick_rate)
    from astb.session import build_rig, bus_stages
    from bench_protocol.runtime.pacing import Late
    from bench_sim.rig.process import run_rig

    rig, path = read_rig(rig_named)
    simulation = _at_bit_rate(simulated(_simulated_only(rig, path), path, model, effects, sealed), bit_rate)
    try:
        bench = build_rig(simulation, seed)
        stages = bus_stages(bench, simulation)
    except ValueError as error:
        misuse(error)
    _look_at_springs(bench)
    stop = threading.Event()
    _listen(bench, stop, until_eof)
    try:
        with ended_by(partial(_stop, stop)), _captured(capture, live=capture_port is not None) as listener:
            run_rig(
                bench,
                can=can or rig.can.bus,
                host=rig.can.host,
                can_port=rig.can.port if can_port is None else can_port,
                modbus_port=rig.modbus.port if modbus_port is None else modbus_port,
                allow_remote=allow_remote,
                beacon=beacon,
                policy=Late[simulation.late_ticks.upper()],
                stages=stages,
                capture=listener,
                capture_port=capture_port,
                stop=stop,
                ready=_say_ready,
            )
    except ValueError as error:
        misuse(error)
    except OSError as error:
        blocked(error)


def _look_at_springs(bench: "Rig") -> None:
    """Print notes on springs that an FMU computes. An FMU that is too slow for real time ends the command."""
    if bench.springs is None:
        return
    bench.springs.limit_timeout()
    for line in bench.springs.notes:
        click.echo(f"astb: {line}", err=True)
    if bench.springs.too_slow:
        blocked(
            "the FMU of the springs is too slow for real time; use virtual time, a longer step or a faster FMU"
        )


def _say_ready(can: str, modbus: str, control: str) -> None:
    click.echo(f"ready can={can} modbus={modbus} control={control}")


def _simulated_only(rig: "RigFile", path: Path) -> "RigFile":
    """Return ``rig`` if it is a simulated one. A real rig ends the command."""
    if rig.simulation is None:
        misuse(f"rig file {path} describes a real rig (no [simulation] table), so it cannot be simulated")
    return rig


def _at_bit_rate(rig: "RigFile", bit_rate: str | None) -> "Simulation":
    """Return the simulation of ``rig`` with the bit rate of the option, if there is one."""
    simulation = rig.simulation
    assert simulation is not None
    return replace(simulation, can=replace(simulation.can, bit_rate=bit_rate)) if bit_rate else simulation


@contextmanager
def _captured(path: Path | None, *, live: bool) -> "Iterator[Capture | None]":
    """Yield a capture of the bus traffic, which is also written to the file ``path``.

    Without a file and without ``live``, yield None.
    """
    from bench_sim.rig.capture import Capture, CaptureFile

    capture = Capture()
    if path is None:
        yield capture if live else None
        return
    with closing(CaptureFile(capture, path, lambda reason: click.echo(f"astb: {reason}", err=True))):
        yield capture


def _listen(bench: "Rig", stop: threading.Event, until_eof: bool) -> None:
    """Let SIGUSR1 press and SIGUSR2 release the emergency stop.

    With ``until_eof``, the end of the standard input stops the rig.
    """
    if until_eof:  # the process that started this rig holds the other end, so the rig stops with it
        threading.Thread(target=_when_stdin_ends, args=(stop.set,), daemon=True).start()
    signal.signal(signal.SIGUSR1, lambda *_: bench.press_estop())
    signal.signal(signal.SIGUSR2, lambda *_: bench.release_estop())


def _stop(stop: threading.Event, by: str) -> None:
    """Stop the rig, and print the cause if the user may not know it."""
    if not stop.is_set() and by in UNAWARES:
        click.echo(f"astb: the rig was ended by {by}", err=True)
    stop.set()


def _when_stdin_ends(call: Callable[[], object]) -> None:
    sys.stdin.read()
    call()


def _at_tick_rate(tick_rate: str | None) -> None:
    """Start the command again if this process has another tick rate, because the rate is compiled into the rig."""
    if tick_rate is None or int(tick_rate) == TICK_RATE:
        return
    environment = os.environ | {TICK_RATE_VARIABLE: tick_rate}
    os.execve(sys.executable, [sys.executable, "-m", "astb", *sys.argv[1:]], environment)
