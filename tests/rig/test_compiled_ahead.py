"""A serving rig compiles no code: a client would get no answer for a second."""

import pytest

from tests.own_process import output_of

SCENARIO = """
import sys
from numba.core.registry import CPUDispatcher
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from tests.rig.conftest import Commander
{also}

def compiled():
    return {{
        f"{{where}}.{{name}}": len(one.signatures)
        for where, module in list(sys.modules.items())
        if where.startswith(("bench_protocol.", "bench_sim."))
        for name, one in vars(module).items()
        if isinstance(one, CPUDispatcher) and one.__module__ == where
    }}

commander = Commander(Rig(load("astb"), seed=1))
commander.cycle(1)  # the ticks are loaded by the first of them
before = compiled()
assert "bench_protocol.e2e.token_mark" in before and "bench_sim.rig.tick.run_ticks" in before
commander.arm()
commander.hold_height()
commander.cycle(20)
{then}
print(sorted(name for name, count in compiled().items() if count > before.get(name, 0)))
"""
FAULTS = """
for name in FAULTS:
    stand = FaultRig()
    SEEN[name](stand)
"""
OF_FAULTS = """
import drivers.cycle  # what a commander needs is compiled when he begins
from bench_sim.rig.faults.catalogue import FAULTS
from tests.system import faults_in_the_bench, faults_on_the_wires
from tests.system.fault_stand import SEEN, FaultRig
"""


@pytest.mark.parametrize(
    ("also", "then"),
    [("", ""), pytest.param(OF_FAULTS, FAULTS, marks=pytest.mark.slow)],
    ids=["commanded", "with every fault"],
)
def test_a_serving_rig_compiles_no_code(also: str, then: str) -> None:
    assert output_of(SCENARIO.format(also=also, then=then)) == "[]\n"
