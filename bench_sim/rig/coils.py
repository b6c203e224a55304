"""What each coil of the rig does, and what each of its contacts tells."""

from collections.abc import Callable, Mapping
from functools import partial

from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.words import FAULTS, LIVE, BenchState
from bench_sim.rig.generator import FunctionGenerator
from bench_sim.rig.states import Event
from bench_sim.rig.supervisor import Supervisor


def coil_actions(
    supervisor: Supervisor, generator: FunctionGenerator, apply: Callable[[], bool]
) -> Mapping[str, Callable[[], bool]]:
    """Return what each coil does, and whether the present state allowed it; ``apply`` takes over what is staged."""
    return _of_every(
        Kind.ACTION,
        {
            "apply": apply,
            "reset": supervisor.reset,
            "power_on": partial(supervisor.handle, Event.POWER_ON),
            "power_off": partial(supervisor.handle, Event.POWER_OFF),
            "air_low": partial(supervisor.handle, Event.AIR_LOW),
            "air_high": partial(supervisor.handle, Event.AIR_HIGH),
            "disable": partial(supervisor.handle, Event.DISABLE),
            "program_run": supervisor.run_program,
            "program_hold": generator.hold,
            "program_stop": generator.stop,
            "program_add": supervisor.add_to_program,
            "program_car": supervisor.run_car,
        },
    )


def contacts(supervisor: Supervisor, staged: Callable[[], bool]) -> Mapping[str, Callable[[], bool]]:
    """Return what identifies of each interlock whether it is set, and of what is ``staged``."""
    return _of_every(
        Kind.INTERLOCK,
        {
            "estop": lambda: supervisor.estop,
            "pneumatic": lambda: supervisor.state not in (*LIVE, BenchState.FAULT_HOLD),
            "program": lambda: supervisor.state is not BenchState.ACTIVE,
            "command": supervisor.command_valid,
            "limits": lambda: supervisor.limits_broken,
            "fault": lambda: supervisor.state in FAULTS,
            "staged": staged,
        },
    )


def _of_every(kind: Kind, told: Mapping[str, Callable[[], bool]]) -> Mapping[str, Callable[[], bool]]:
    """Return ``told`` by the last part of the names; ValueError unless it has every signal of ``kind`` in the table."""
    names = {signal.attribute[1] for signal in TABLE.of_kind(kind)}
    if different := names ^ told.keys():
        raise ValueError(f"table and rig differ in the {kind}s {', '.join(sorted(different))}")
    return told
