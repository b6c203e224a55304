"""Springs in lock-step against the scalar replay, which is their oracle."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.lanes.layout import LANES
from bench_sim.model.lanes.springs import integrate_pairs, integrate_springs
from bench_sim.model.lanes.start import has_lanes, power_coefficients
from bench_sim.model.lanes.traces import TracedReplay
from bench_sim.model.layout import INPUTS, Input, Sensor
from bench_sim.model.quantities import QUANTITIES, Lanes
from bench_sim.model.replay import DIRECTIONS, STEP, Before, Gas, Motion, replay
from bench_sim.parameters import load
from tests.refusals import refuses

INTERVAL = 5e-3
#: What each column of a trace is.
COLUMNS = (
    Algebraic.PRESSURE,
    Algebraic.TEMPERATURE,
    Algebraic.AUXILIARY_PRESSURE,
    Algebraic.AUXILIARY_TEMPERATURE,
    Algebraic.STACK_VERTICAL,
    Algebraic.STACK_LATERAL,
    Algebraic.CONTACT,
)
#: How far lanes and scalar kernel may be apart: Pa, K, Pa, K, N, N, m. The scalar Newton's method ends at 0.3 µm.
CLOSE = (5e-3, 1e-5, 5e-3, 1e-5, 2e-3, 2e-4, 1e-6)


def shaken(samples, amplitude=3e-3):
    """A bench shaken in all directions, with the reservoir valve of one side shut for a while."""
    time = INTERVAL * np.arange(samples)
    tau, fade = 2.0 * np.pi * time, np.clip(2.0 * time, 0.0, 1.0)
    displacement = np.zeros((samples, DIRECTIONS))
    displacement[:, 0] = fade * 2.0 * amplitude * np.sin(0.9 * tau)
    displacement[:, 1] = fade * amplitude * (np.sin(1.2 * tau) + 0.3 * np.sin(6.0 * tau))
    displacement[:, 2] = fade * amplitude * np.sin(0.7 * tau)
    displacement[:, 4] = fade * 0.2 * amplitude * np.sin(2.0 * tau)
    inputs = np.zeros((samples, INPUTS))
    inputs[:, [Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = 1.0
    inputs[samples // 3 : samples // 2, Input.RIGHT_RESERVOIR_VALVE] = 0.0
    return SimpleNamespace(
        motion=Motion.through(displacement, INTERVAL),
        inputs=inputs,
        supply=np.full(samples, 9e5),
        gas=Gas(np.array([3.1e5, 2.9e5, 3.1e5, 2.9e5]), np.full(4, 293.15)),
    )


def traced(record, run):
    return TracedReplay(record, run.motion, run.inputs, run.supply, step=STEP, start=0.0)


SPRINGS = {
    "as delivered": {},
    "leaking, with warm walls": {
        "leak_conductance": 2e-10,
        "leak_laminar": 1e-14,
        "wall_temperature_offset": 4.0,
    },
    "with a capacity in its walls": {"wall_heat_capacity": 400.0, "wall_outer_heat_transfer": 3.0},
    "soft, creeping, one-way": {"bellows_compliance": 2e-9, "creep_ratio": 0.2, "orifice_asymmetry": 0.3},
    "with an area that grows with pressure": {"effective_area_growth": 3e-7, "bellows_compliance": 2e-9},
    "with a choked, viscous orifice": {"orifice_diameter": 4e-3, "orifice_reynolds": 30.0},
    "with inertia in its connection": {"flow_inertance": 800.0},
    "with much inertia and a one-way orifice": {"flow_inertance": 5e3, "orifice_asymmetry": -0.2},
    "with hardly any inertia": {"flow_inertance": 1e-3},
    "with more rubber": {
        "extra_branch_ratio": [0.3, 0.2] + [0.0] * 10,
        "extra_branch_time": [0.01, 0.5] + [1.0] * 10,
        "extra_friction": [150.0, 80.0, 40.0, 0.0, 0.0, 0.0],
        "extra_friction_travel": [3e-4, 3e-3, 1e-2, 0.1, 0.1, 0.1],
    },
    "sitting on its emergency spring": {"contact_height": -1e-3},
}


@pytest.mark.parametrize("name", SPRINGS)
def test_lanes_go_where_the_scalar_replay_goes(name):
    record = load("astb").with_values(**SPRINGS[name]).record
    run = shaken(300)
    rows = np.zeros((300, ALGEBRAICS))
    before = Before.at_rest()
    before.crept[:] = 1e-4, 2e-4
    before.behind[:2] = np.outer((3e-3, -1e-3), (1.0, 2.0, 3.0, 4.0))
    readings = replay(record, run.motion, run.inputs, run.supply, run.gas, before=before, rows=rows)
    both = traced(record, run)
    traces = integrate_springs(both.springs(record, run.gas, 0.0, before))
    for i, trace in enumerate(traces):
        for k, what in enumerate(COLUMNS):
            error = np.abs(trace[:: both.steps, k] - rows[:, what + i]).max()
            assert error < CLOSE[k], (i, what.name)
    again = both.readings(record, traces, 0.0)
    noise = record.sensor_noise + record.sensor_resolution
    apart = np.abs(again - readings).max(axis=0) / noise
    # The loss of a contact goes with a compression that the scalar kernel knows to 0.3 µm.
    assert apart.max() < (5e-3 if name == "sitting on its emergency spring" else 3e-4)


def joined(samples):
    """A bench that is shaken while the differential pressure valve opens and shuts, and leveling valves work."""
    run = shaken(samples, 6e-3)
    run.inputs[:, Input.DPV_CONNECTED] = 1.0
    run.inputs[:, [Input.LEFT_LEVELING, Input.RIGHT_LEVELING]] = 1.0
    run.inputs[samples // 4 : samples // 2, Input.LEFT_SERVICE_VALVE] = 0.7
    run.inputs[samples // 2 :, Input.RIGHT_SERVICE_VALVE] = -0.4
    run.gas.pressure[[0, 2]] += 1.5e5
    return run


def test_pairs_with_air_between_them_go_where_the_scalar_replay_goes():
    """Four benches at a time: off their height, leaking between the sides, with another valve and another supply."""
    run = joined(400)
    low = {"lever_offset": [0.012, -0.012]}
    benches = [
        (load("astb").with_values(**low | values).record, error)
        for values, error in (
            ({}, 0.0),
            ({"dpv_leak": 3e-10}, 0.0),
            ({"dpv_opening": 6e4, "dpv_reclosing": 3e4}, 0.0),
            ({}, 3e5),
        )
    ]
    both = traced(benches[0][0], run)
    pairs = [both.springs(record, run.gas, 0.0, supply_error=error) for record, error in benches]
    together = integrate_pairs(pairs)
    for (record, error), traces in zip(benches, together, strict=True):
        rows = np.zeros((400, ALGEBRAICS))
        replay(record, run.motion, run.inputs, run.supply - error, run.gas, rows=rows)
        for i, trace in enumerate(traces):
            for k, what in enumerate(COLUMNS):
                assert np.abs(trace[:: both.steps, k] - rows[:, what + i]).max() < CLOSE[k], (i, what.name)
            for flow in (Algebraic.DPV_FLOW, Algebraic.LEVELING_FLOW + i, Algebraic.SERVICE_FLOW + i):
                assert np.ptp(rows[:, flow]) > 1e-3, "air passes every valve"
    (alone,) = integrate_pairs(pairs[1:2])
    assert all(map(np.array_equal, alone, together[1])), "bit for bit, in any batch"


def test_a_lane_does_not_depend_on_its_neighbours():
    """Bit for bit, whatever their parameters, sides, lengths and friction."""
    record = load("astb").record
    rubber = load("astb").with_values(**SPRINGS["with more rubber"]).record
    short, long = shaken(120), shaken(200, 6e-3)
    ours = traced(record, short).springs(record, short.gas, 0.0)
    others = traced(rubber, long).springs(rubber, long.gas, 1e-3)
    alone = integrate_springs(ours[1:])[0]
    together = integrate_springs((others[0], ours[1], others[1], ours[0], ours[1]))
    assert np.array_equal(together[1], alone)
    assert np.array_equal(together[4], alone)
    assert len(together[0]) > len(alone) == len(together[3])


def test_a_shift_is_a_bolster_further_to_the_left():
    record = load("astb").record
    run = shaken(150)
    moved = run.motion.displacement + 2e-3 * np.eye(DIRECTIONS)[0]
    shifted = replay(record, run.motion._replace(displacement=moved), run.inputs, run.supply, run.gas)
    both = traced(record, run)
    readings = both.readings(record, integrate_springs(both.springs(record, run.gas, 2e-3)), 2e-3)
    cells = slice(Sensor.LOAD_CELL_5, Sensor.LOAD_CELL_6 + 1)
    assert np.abs(readings[:, cells] - shifted[:, cells]).max() < 1e-3
    assert (
        np.abs(readings - both.readings(record, integrate_springs(both.springs(record, run.gas, 0.0)), 0.0))[
            :, cells
        ].max()
        > 10.0
    )


@pytest.mark.parametrize("kappa", [1.3, 1.4, 1.66])
def test_the_power_of_the_nozzle_is_a_polynomial(kappa):
    t = np.linspace(-1.0, 1.0, 2001)
    low = (2.0 / (kappa + 1.0)) ** (kappa / (kappa - 1.0))
    r = 0.5 * (1.0 + low) + 0.5 * (1.0 - low) * t
    power = np.polynomial.polynomial.polyval(t, power_coefficients(kappa))
    assert np.abs(power / r ** (1.0 / kappa) - 1.0).max() < 1e-13


def test_lanes_skip_unsupported_cases():
    assert has_lanes(load("astb").record)
    for values in (
        {"pipe_length": 1.5},
        {"emergency_spring": 0.0},
        {"extra_friction": 10.0},
    ):
        assert not has_lanes(load("astb").with_values(**values).record)
    record = load("astb").record
    run = shaken(20)
    springs = traced(record, run).springs(record, run.gas, 0.0)
    with refuses(ValueError, "1 8 springs"):
        integrate_springs(springs * LANES)
    fine = TracedReplay(record, run.motion, run.inputs, run.supply, step=1e-3, start=0.0)
    with refuses(ValueError, "1 4 pairs"):
        integrate_pairs([springs] * 5)
    with refuses(ValueError, "together"):
        integrate_springs((springs[0], fine.springs(record, run.gas, 0.0)[0]))


def test_a_quantity_is_for_the_lanes_what_its_row_says():
    """Unsupported effects go to the scalar replay unless their size is zero; moved signals are not needed."""
    sound, run = load("astb").record, shaken(20)
    assert has_lanes(sound)
    replayed = traced(sound, run)
    keys = [spring.key for spring in replayed.springs(sound, run.gas, 0.0)]
    for one in QUANTITIES:
        changed = sound.copy()
        changed[one.name] = np.asarray(sound[one.name]) + 1e-3
        if not one.lanes:
            assert not has_lanes(changed), one.name
        elif one.lanes is Lanes.NOT_IN_LANES:
            assert has_lanes(changed)
            assert [spring.key for spring in replayed.springs(changed, run.gas, 0.0)] == keys, one.name
