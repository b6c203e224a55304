"""The rig in plain Python (NUMBA_DISABLE_JIT=1) sends the bytes of the compiled one."""

import pytest

from tests.own_process import output_of

#: Arms a rig, moves it by set-points and by its generator, fills a spring, and prints the state and all frames.
RIDE = """
from bench_protocol.words import AIR_MODES, AXES
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from tests.rig.conftest import Commander

commander = Commander(Rig(load("astb", "AW0"), seed=3))
run = commander.rig.run
sent = []
def kept(ticks):
    block = run(ticks)
    sent.append(block.tobytes())
    return block
commander.rig.run = kept
commander.arm()
commander.hold_height()
commander.cycle(2, lateral_force_setpoint=500.0, platform_vertical_setpoint=1e-3)
commander.apply(
    generator_axis=AXES.index("platform_lateral"), generator_amplitude=1e-3,
    generator_frequency=20.0, generator_cycles=2,
    air_left_mode=AIR_MODES.index("fill"), air_left_target=1e5,
)
assert commander.coil("program_run")[0] == 5
commander.cycle(4)
for name, values in (
    ("bias", '"sensor": "left.height", "value": "1 mm"'),
    ("noise", '"sensor": "right.height", "value": "0.1 mm"'),
    ("spike", '"sensor": "left.bellows_pressure", "value": "0.1 bar", "rate": "50 Hz"'),
    ("stuck", '"sensor": "lateral.force"'),
    ("drift", '"sensor": "load_cell.1", "value": "1 kN/s"'),
    ("broken_wire", '"sensor": "load_cell.6", "reads": "nothing"'),
    ("seized_actuator", '"actuator": "lateral"'),
):
    order = '{"do": "on", "name": "%s", "values": {%s}}' % (name, values)
    assert b"error" not in commander.rig.order(order.encode()), name
commander.cycle(4)
commander.rig.press_estop()
commander.wait(20)
print(commander.state, b"".join(sent).hex())
"""


@pytest.mark.slow
def test_the_plain_rig_sends_the_bytes_of_the_compiled_one() -> None:
    compiled, plain = output_of(RIDE), output_of(RIDE, NUMBA_DISABLE_JIT="1")
    assert compiled.startswith("ESTOP ")
    assert len(compiled) > 2 * 16 * 1000, "some thousand frames"
    assert plain == compiled
