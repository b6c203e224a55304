"""The bench as an FMU: what others simulate is the plant, from rest and from without air, in every mode."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from astb.fmu.models.bench import bench, structured
from astb.fmu.unit import Kind
from bench_protocol.table_signals import MEASUREMENTS
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.layout import ACTUATORS, Input, Mode
from bench_sim.model.plant import Plant
from bench_sim.model.quantities import PLANT_QUANTITIES
from bench_sim.parameters import load
from tests.fmu.test_spring_fmu import VERSIONS, equal

pytestmark = pytest.mark.slow

TICKS = 200
#: Inputs that are moved: name, and where the plant has it.
MOVED = {
    "vertical_left.force_setpoint": Input.VERTICAL_LEFT_COMMAND,
    "vertical_right.force_setpoint": Input.VERTICAL_RIGHT_COMMAND,
    "lateral.force_setpoint": Input.LATERAL_COMMAND,
    "lateral.displacement_setpoint": Input.LATERAL_COMMAND,
    "lateral.control": Input.LATERAL_MODE,
    "platform.vertical_setpoint": Input.PLATFORM_VERTICAL,
    "platform.lateral_setpoint": Input.PLATFORM_LATERAL,
    "platform.roll_setpoint": Input.PLATFORM_ROLL,
    "left.leveling": Input.LEFT_LEVELING,
    "right.service_valve": Input.RIGHT_SERVICE_VALVE,
    "air.left_reservoir": Input.LEFT_RESERVOIR_VALVE,
}
FURTHER = {
    "left.vertical_force": Algebraic.VERTICAL_FORCE,
    "right.lateral_force": Algebraic.LATERAL_FORCE + 1,
    "left.orifice_flow": Algebraic.ORIFICE_FLOW,
    "lateral.stop_force": Algebraic.BUMP_STOP,
}
READ = tuple(structured(one.name) for one in MEASUREMENTS)
OUTPUTS = (*READ, *FURTHER)


def shaken(ticks: int) -> dict[str, np.ndarray]:
    """Inputs (n,) of so many ticks each, which move everything that moves."""
    t = 1e-3 * ticks * np.arange(TICKS // ticks)
    late = t >= 0.1
    return {
        "vertical_left.force_setpoint": 47e3 + 6e3 * np.sin(18.0 * t),
        "vertical_right.force_setpoint": 47e3 + 4e3 * np.sin(54.0 * t),
        "lateral.force_setpoint": 3e3 * np.sin(36.0 * t),
        "lateral.displacement_setpoint": 4e-3 * np.sin(30.0 * t),
        "lateral.control": np.where(late, float(Mode.DISPLACEMENT), float(Mode.FORCE)),
        "platform.vertical_setpoint": 2e-3 * np.sin(25.0 * t),
        "platform.lateral_setpoint": 1e-3 * np.sin(40.0 * t),
        "platform.roll_setpoint": 3e-3 * np.sin(20.0 * t),
        "left.leveling": late.astype(float),
        "right.service_valve": np.where(late, -0.5, 0.0),
        "air.left_reservoir": np.where(t >= 0.15, 0.0, 1.0),
    }


def of_the_plant(plant: Plant, given: dict[str, np.ndarray], ticks: int) -> np.ndarray:
    """Outputs (n, OUTPUTS) of a plant that was given the same."""
    rows = []
    for n in range(TICKS // ticks):
        moves_by_force = given["lateral.control"][n] == Mode.FORCE
        for name, place in MOVED.items():
            if place == Input.LATERAL_COMMAND and (name == "lateral.force_setpoint") != moves_by_force:
                continue
            plant.inputs[place] = given[name][n]
        plant.step(ticks)
        values = plant.ideal()
        rows.append([*values, *(plant._algebraic[place] for place in FURTHER.values())])
    return np.array(rows)


@pytest.mark.parametrize("ticks", [1, 5, 20])
def test_it_does_what_the_plant_does(bench_fmus, isolated, ticks):
    """Also when it is saved, and gone on with in another instance."""
    given = shaken(ticks)
    right = of_the_plant(Plant.at_rest(load().record), given, ticks)
    times = 1e-3 * ticks * np.arange(TICKS // ticks + 1)
    motion = np.stack([given[name] for name in MOVED], axis=1)
    for version in VERSIONS if ticks == 5 else (3,):
        got = isolated(
            bench_fmus[version], "motion", names=list(MOVED), times=times, motion=motion, outputs=OUTPUTS
        )
        assert got["outputs"] == got["again"]
        assert equal(np.array(got["outputs"]), right, 1e-12)
    assert np.ptp(right, axis=0).min() >= 0.0
    assert np.ptp(right[:, [0, 1, 2, 11, 16, 17, 21]], axis=0).min() > 1e-4


def test_the_fmu_starts_without_air_like_the_plant(bench_fmus, isolated):
    plant = Plant.depressurised(load().record)
    plant.inputs[Input.SUPPLY] = 1.0
    plant.inputs[[Input.LEFT_SERVICE_VALVE, Input.RIGHT_SERVICE_VALVE]] = 1.0
    rows = []
    for _ in range(20):
        plant.step(20)
        rows.append(plant.ideal())
    off = {f"{one}.control": 0.0 for one in ("vertical_left", "vertical_right", "lateral")}
    assert len(off) == ACTUATORS
    begin = {"air.at_start": 0.0, "supply.open": 0.0, **off}
    moved = {"supply.open": 1.0, "left.service_valve": 1.0, "right.service_valve": 1.0}
    got = isolated(
        bench_fmus[3],
        "motion",
        names=list(moved),
        times=0.02 * np.arange(21),
        motion=np.broadcast_to([*moved.values()], (20, len(moved))),
        outputs=READ,
        begin=list(begin),
        begin_values=[*begin.values()],
    )
    assert equal(np.array(got["outputs"]), np.array(rows), 1e-12)
    assert got["outputs"][-1][2] > 100.0, "it fills"


@pytest.mark.parametrize("version", VERSIONS)
def test_another_tool_finds_no_fault(bench_fmus, car_fmus, isolated, version):
    for fmu in (bench_fmus[version], car_fmus[version]):
        assert isolated(fmu, "validate") == {"problems": [], "version": f"{version}.0"}


def test_its_state_is_all_there_is(bench_fmus, isolated):
    got = isolated(bench_fmus[3], "bench_refusals")
    assert got["mode"] == ["vertical_left.control = 1.5 is not one of the whole numbers 0 to 3"]
    assert got["range"] == ["platform.roll_setpoint = 1 rad is outside -0.3 to 0.3 rad"]
    assert got["fixed"] == ["left.nominal_preload stays as it is once the simulation has begun"]
    assert got["rest"] < 1e-6, "it stays where it begins"


def test_every_parameter_of_a_law_is_one_of_the_fmu():
    """Only the inputs of the bench's laws and of its sensors can be set."""
    laws = (
        *(
            "actuator",
            "air_spring",
            "bellows",
            "bench_rest",
            "bolster",
            "gas",
            "inertance",
            "orifice",
            "pipe",
            "rest",
            "rubber",
        ),
        *("runge_kutta", "sensors", "spring", "step_start", "surface", "valves"),
    )
    folder = Path(sys.modules[Plant.__module__].__file__).parent
    read = {name for law in laws for name in re.findall(r"par\.(\w+)", (folder / f"{law}.py").read_text())}
    given = {
        re.sub(r"^(left|right|vertical_left|vertical_right|lateral)\.|\[.*", "", one.name)
        for one in bench(load()).variables
        if one.kind in (Kind.FIXED, Kind.TUNABLE)
    }
    chain = {"load_cell_crosstalk", "force_latency", "displacement_latency"}
    chain |= {one.name for one in PLANT_QUANTITIES if one.name.startswith("pressure_")}
    assert given == (read & {one.name for one in PLANT_QUANTITIES}) - chain
