"""Connects a bench with a rig: in memory and virtual time, or over CAN and Modbus in real time."""

import contextlib
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from msgspec import json, to_builtins

from astb.exit_codes import MISUSE
from astb.operators import SimulatedHand
from astb.rig_file import RigFile, RigFileError, Simulation, read
from bench_protocol.clock import Clock, RealClock, hurry_process
from bench_protocol.named_files import place_of
from bench_protocol.runtime import require_linux
from bench_protocol.table import TABLE
from bench_protocol.units import ms, s
from bench_sim.fmu.description import FmuError
from bench_sim.parameters import load
from bench_sim.parameters.dimensions import dimensions_of as simulated
from bench_sim.parameters.effects import read_effect_text, with_effects
from bench_sim.parameters.model_file import load_effects, read_changes, with_changes
from drivers.bench import Bench
from drivers.errors import LinkLost
from drivers.wiring.described import open_described
from drivers.wiring.description import PACKAGE, describe, read_description
from drivers.wiring.own import own_description
from test_plans.instruments import UNKNOWN, InstrumentsError, ordinary, read_instruments

if TYPE_CHECKING:
    from bench_protocol.dimensions import Dimensions
    from bench_protocol.frames import Block
    from bench_sim.parameters import Parameters
    from bench_sim.rig.can_bus import Stage
    from bench_sim.rig.faults.panel import PlannedFault
    from bench_sim.rig.rig import Rig
    from bench_sim.rig.spring_fmu.springs import SpringFmu
    from drivers.can_port import CanPort
    from drivers.wiring.contract import Wiring
    from drivers.wiring.lines import Description
    from test_plans.instruments import Instruments

#: A first start compiles the model; afterwards the rig is up within two seconds.
START_LIMIT: Final = 180 * s
STOP_LIMIT: Final = 5 * s


@dataclass(frozen=True)
class Session:
    """A bench to run plans on, and the origin for its records."""

    bench: Bench
    clock: Clock
    virtual: bool
    parameters: "Parameters | None"  #: of the simulation, None for a real rig
    seed: int | None
    wiring: "Description | None" = None  #: of a rig that does not use our protocol
    listen: "Callable[[], CanPort] | None" = (
        None  #: opens another port of the CAN bus, which receives the frames of all others
    )


def simulated_parameters(simulation: Simulation) -> "Parameters":
    """Return the parameter set of the rig file, without its sealed effects (hidden from the user for blind tests).

    Raises ParameterError, with name, value, unit and correct form, for an invalid parameter or effect.
    """
    parameters = with_changes(load(simulation.parameters), read_changes(simulation.change))
    effects = {name: read_effect_text(name, text) for name, text in simulation.effects.items()}
    return with_effects(parameters, effects)


def build_rig(simulation: Simulation, seed: int | None = None) -> "Rig":
    """Return the simulated rig, not yet running, with the requested faults.

    Raises ParameterError like `simulated_parameters`, FaultError, and ValueError for an invalid limit.
    """
    from bench_sim.rig.limit_table import limits_of
    from bench_sim.rig.rig import Rig

    parameters = simulated_parameters(simulation)
    if simulation.sealed:
        parameters = with_effects(parameters, load_effects(Path(simulation.sealed)))
    limits = limits_of(simulation.limits)
    seed = simulation.seed if seed is None else seed
    rig = Rig(parameters, seed=seed, limits=limits, springs=springs_of(simulation, parameters.as_built(seed)))
    for planned in planned_faults(simulation):
        rig.faults.plan(planned)
    return rig


def springs_of(simulation: Simulation, parameters: "Parameters") -> "SpringFmu | None":
    """Return the springs of the FMU that the rig file names, tested and started; None if it names none.

    Raises FmuError for an FMU or a map that cannot be used.
    """
    if not simulation.spring:
        return None
    from bench_sim.rig.spring_fmu.springs import SpringFmu

    springs = SpringFmu(Path(simulation.spring), simulation.spring_map, parameters.record)
    sound = load(simulation.parameters)
    changed = [
        name for name in sorted(springs.owned) if (parameters.record[name] != sound.record[name]).any()
    ]
    if changed:
        springs.close()
        raise FmuError(
            f"simulation.change or simulation.effects set {', '.join(changed)} of the springs of the model, but "
            f"{simulation.spring} replaces these springs; set spring_map.parameters instead"
        )
    return springs


def planned_faults(simulation: Simulation) -> "list[PlannedFault]":
    """Return the faults of the rig file. Raises FaultError for an impossible time."""
    from bench_sim.rig.faults.orders import read_time
    from bench_sim.rig.faults.panel import PlannedFault

    return [
        PlannedFault(one.name, one.values, read_time("at", one.at) or 0.0, read_time("for", one.lasting))
        for one in simulation.faults
    ]


def bus_stages(rig: "Rig", simulation: Simulation) -> list["Stage"]:
    """Return the stages on the CAN bus of ``rig``: a limit of the bit rate, if one is requested.

    Raises ValueError for an invalid bit rate.
    """
    from bench_sim.rig.pace import Pace, read_bit_rate

    can = simulation.can
    if not can.bit_rate:
        return []
    pace = Pace(
        read_bit_rate(can.bit_rate),
        stuffing=can.stuffing,
        error_rate=can.error_rate,
        restart=can.restart,
        seed=simulation.seed,
        tell=rig.report_bus,
    )
    return [pace]


@contextlib.contextmanager
def open_session(
    rig: RigFile,
    path: Path,
    *,
    virtual: bool = False,
    seed: int | None = None,
    say: Callable[[str], None] = print,
) -> Iterator[Session]:
    """Yield a session with ``rig``; the bench is not yet connected.

    A simulated rig in real time that does not answer is started in its own process and stopped at the end. Raises
    RigFileError for a real rig in virtual time, or if another model of the rig is already running.
    """
    if virtual or rig.time == "virtual":
        if rig.simulation is None:
            raise RigFileError(f"rig file {path}: there is no [simulation] table; virtual time needs one")
        simulated = build_rig(rig.simulation, seed)
        for line in simulated.springs.notes if simulated.springs else ():
            say(line)
        try:
            with virtual_session(simulated, rig.simulation, seed) as session:
                describe_rig(session.bench, rig, path)
                yield session
        finally:
            if simulated.spring_lost:
                say(f"the FMU of the springs failed: {simulated.spring_lost}")
        return
    require_linux("a rig in real time")
    with contextlib.ExitStack() as stack:
        if rig.simulation and not answers(rig):
            say(f"no rig answers at {rig.modbus.host}:{rig.modbus.port}: starting one")
            stack.enter_context(started(rig.simulation, path, seed, say))
        elif rig.simulation and rig.simulation != read(path).simulation:
            raise RigFileError(
                f"a rig with another model or other effects is running at {rig.modbus.host}:{rig.modbus.port} already; "
                "stop it, or run in virtual time"
            )
        elif rig.simulation and seed is not None:
            say("the rig is running already; its seed does not change")
        session = stack.enter_context(real_session(rig, path, seed))
        describe_rig(session.bench, rig, path)
        yield session


@contextlib.contextmanager
def virtual_session(
    rig: "Rig",
    simulation: Simulation,
    seed: int | None = None,
    run: "Callable[[int], Block] | None" = None,
    absent: Mapping[str, str] | None = None,
) -> Iterator[Session]:
    """Yield a session with ``rig`` in this process. Time passes while the plan waits, as fast as the machine can.

    ``run`` replaces ``rig.run`` if a caller observes the rig between its ticks; ``absent`` are signals that the bench
    must not use, with the reasons.
    """
    from astb.rig_in_memory import RigInMemory
    from bench_sim.rig.faults.orders import execute_order

    known = simulation.seed if seed is None else seed
    parameters = simulated_parameters(simulation).as_built(known)
    memory = RigInMemory(rig, run)
    for stage in bus_stages(rig, simulation):
        memory.bus.add(stage)
    bench = memory.bench(absent=absent)
    bench.instruments = ordinary()
    bench.hand = SimulatedHand(
        lambda order: json.decode(execute_order(rig.faults, json.encode(order), nullcontext()))
    )
    try:
        yield Session(bench, memory.clock, True, parameters, known, listen=memory.can)
    finally:
        bench.close()


@contextlib.contextmanager
def real_session(rig: RigFile, path: Path, seed: int | None = None) -> Iterator[Session]:
    """Yield a session with a running rig, real or simulated, with any wiring.

    Raises WiringError for an invalid wiring before anything is connected.
    """
    from bench_sim.rig.control_socket import ask, control_path
    from drivers.can_port import open_can

    hurry_process()
    clock = RealClock()
    with contextlib.closing(open_wiring(rig, path)) as wiring:
        bench = Bench(wiring, clock)
        simulation = rig.simulation
        if simulation:
            bench.hand = SimulatedHand(
                lambda order: json.decode(
                    ask(control_path(rig.modbus.host, rig.modbus.port), json.encode(order))
                )
            )
        parameters = simulated_parameters(simulation) if simulation else None
        known = simulation.seed if simulation and seed is None else seed
        described = wiring_of(rig, path) if rig.wiring else None
        bus = None if described else partial(open_can, rig.can.bus, host=rig.can.host, port=rig.can.port)
        with contextlib.closing(bench):
            yield Session(bench, clock, False, parameters, known, described, bus)


def open_wiring(rig: RigFile, path: Path) -> "Wiring":
    """Return the wiring of ``rig``, whose file is ``path``, not yet connected. Raises WiringError if it is invalid."""
    return open_described(rig.name if rig.wiring else "the rig", wiring_of(rig, path))


def describe_rig(bench: Bench, rig: RigFile, path: Path) -> None:
    """Set the properties of a bench that the rig file states: instruments, dimensions, amplitude control."""
    bench.amplitude_control = rig.amplitude_control
    bench.instruments, bench.dimensions = instruments_of(rig, path), dimensions_of(rig, path)


def dimensions_of(rig: RigFile, path: Path) -> "Dimensions":
    """Return the dimensions of ``rig``, whose file is ``path``. Raises RigFileError for a wrong file of dimensions. A
    simulated rig without such a file, or with that of the virtual bench, has the dimensions with which it is simulated.
    Those of a real rig without such a file are unknown.
    """
    from bench_protocol.dimensions import UNKNOWN, DimensionsError, ordinary, read_dimensions

    known = ordinary() if rig.simulation else UNKNOWN
    if rig.dimensions:
        try:
            known = read_dimensions(rig.dimensions, path.parent)
        except DimensionsError as error:
            raise RigFileError(f"rig file {path}: {error}") from None
    if rig.simulation and known.sha256 == ordinary().sha256:
        return known.built(simulated(simulated_parameters(rig.simulation)))
    return known


def instruments_of(rig: RigFile, path: Path) -> "Instruments":
    """Return the instruments of ``rig``, whose file is ``path``: those of its file of instruments. A simulated rig
    without such a file has those of the virtual bench; those of a real one are unknown. Raises RigFileError for a wrong
    file of instruments.
    """
    if not rig.instruments:
        return ordinary() if rig.simulation else UNKNOWN
    try:
        return read_instruments(rig.instruments, path.parent)
    except InstrumentsError as error:
        raise RigFileError(f"rig file {path}: {error}") from None


def wiring_of(rig: RigFile, path: Path) -> "Description":
    """Return the description of the wiring of ``rig``, whose file is ``path``. Raises WiringError if it is invalid."""
    if not rig.wiring:
        return own_description(can=to_builtins(rig.can), modbus=to_builtins(rig.modbus))
    if isinstance(rig.wiring, str):
        return read_description(place_of(PACKAGE, rig.wiring, path.parent), TABLE)
    return describe(rig.wiring, path, TABLE, "wiring", whole=True)


def answers(rig: RigFile) -> bool:
    """Return whether a Modbus device answers at the rig's address."""
    from drivers.modbus_port import open_modbus

    try:
        port = open_modbus(rig.modbus.host, rig.modbus.port, unit=rig.modbus.unit, timeout=300 * ms)
    except LinkLost:
        return False
    port.close()
    return True


@contextlib.contextmanager
def started(
    simulation: Simulation, path: Path, seed: int | None, say: Callable[[str], None]
) -> Iterator[None]:
    """Run ``astb rig`` for ``path``, with the ``simulation``, in its own process during the block.

    ``say`` gets its ready line.
    """
    with start_rig(simulation, path, seed, subprocess.PIPE) as process:
        try:
            say(ready_line(process))
            yield
        finally:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(STOP_LIMIT)
            process.kill()


def start_rig(simulation: Simulation, path: Path, seed: int | None, lifeline: int) -> subprocess.Popen[str]:
    """Start ``astb rig`` in its own process, with ``lifeline`` as standard input.

    The rig ends when all holders of the other end of this pipe have closed it.
    """
    command = [sys.executable, "-m", "astb", "rig", "--rig", str(path), "--until-eof"]
    command += ["--model", simulation.parameters]
    for name, text in simulation.effects.items():
        command += ["--effect", f"{name}={text}"]
    if simulation.sealed:
        command += ["--sealed", simulation.sealed]
    if seed is not None:
        command += ["--seed", str(seed)]
    pipe = subprocess.PIPE
    # A separate process group: Ctrl-C is for the plan, and its tear-down needs the rig.
    return subprocess.Popen(command, stdin=lifeline, stdout=pipe, stderr=pipe, text=True, process_group=0)


def ready_line(process: subprocess.Popen[str]) -> str:
    """Return the line in which the rig reports that both its ports are open.

    Raises RigFileError or LinkLost, with the rig's own message, if it ends instead.
    """
    assert process.stdout and process.stderr
    watchdog = threading.Timer(START_LIMIT, process.kill)
    watchdog.start()
    try:
        for line in process.stdout:
            if line.startswith("ready "):
                return line.strip()
    finally:
        watchdog.cancel()
    reason = process.stderr.read().strip().removeprefix("astb: ")
    reason = reason or f"it was not ready within {START_LIMIT:g} s; end other programs on this machine"
    error = RigFileError if process.wait() == MISUSE else LinkLost
    raise error(f"the rig could not be started: {reason}")


#: Hash of the signal map, for records.
MAP_HASH: Final = f"{TABLE.map_hash:08x}"
