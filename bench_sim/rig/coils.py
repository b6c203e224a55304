"""The action of each Modbus coil of the rig, and the function that returns the state of each interlock contact."""

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
    """Return the action of each coil, by name. An action returns whether the state of the rig allowed it. ``apply``
    makes staged settings effective.
    """
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
    """Return for each interlock a function that returns its state. True means what its description in the table of
    signals states, such as "The hard-wired emergency stop is pressed" or "Valid commands arrive in time".

    ``staged`` returns whether settings are staged.
    """
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


def _of_every(kind: Kind, functions: Mapping[str, Callable[[], bool]]) -> Mapping[str, Callable[[], bool]]:
    """Return ``functions`` unchanged. Raises ValueError unless there is one for every signal of ``kind`` in the
    table, by the last part of its name.
    """
    names = {signal.attribute[1] for signal in TABLE.of_kind(kind)}
    if different := names ^ functions.keys():
        raise ValueError(f"table and rig differ in the {kind}s {', '.join(sorted(different))}")
    return functions
