"""Springs and car as one SSP file: its connections fit its FMUs, and another tool simulates it."""

import zipfile
from functools import partial

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner
from fmpy.fmi2 import FMU2Slave
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import get_connections, read_ssd

from astb.fmu.cli import fmu_command
from astb.fmu.export import write_unit
from bench_sim.parameters import load
from tests.fmu.test_spring_fmu import equal

pytestmark = pytest.mark.slow

STEP = 1e-3
#: Connectors of the system that `alone.py` moves and reads when it couples both FMUs itself.
DRIVEN = ("car_wind", "track_lateral", "track_vertical", "track_lateral_speed", "track_vertical_speed")
FELT = ("car_acceleration", "car_rising", "car_bump_stop", "car_lean")


@pytest.fixture
def system(spring_fmus, car_fmus, tmp_path, monkeypatch):
    """What `astb fmu` writes, from code that is compiled already."""
    path, compiled = tmp_path / "both.ssp", spring_fmus[2].parent
    monkeypatch.setattr("astb.fmu.system.write_unit", partial(write_unit, compiled=compiled))
    done = CliRunner().invoke(fmu_command, ["springs-with-car", "--out", str(path)])
    assert done.exit_code == 0, done.output
    return path


def fmus_of(system, folder):
    with zipfile.ZipFile(system) as archive:
        archive.extractall(folder)
    components = read_ssd(str(system)).system.elements
    return {one.name: fmpy.read_model_description(folder / one.source) for one in components}


def test_each_connection_joins_variables_that_fit(system, tmp_path):
    """FMPy reads it only if it obeys the schema of SSP."""
    described = {
        name: {one.name: one for one in fmu.modelVariables} for name, fmu in fmus_of(system, tmp_path).items()
    }
    root = read_ssd(str(system)).system
    fed = []
    for start, end in get_connections(root):
        inner = start.parent is not root and end.parent is not root
        variables = [described[one.parent.name][one.name] for one in (start, end) if one.parent is not root]
        assert len({one.unit for one in variables}) == 1
        if start.parent is not root:
            assert (start.kind, variables[0].causality) == ("output", "output")
        if end.parent is not root:
            assert (end.kind, variables[-1].causality) == ("input", "input")
            fed.append((end.parent.name, end.name))
        assert inner or start.kind == end.kind
    assert len(set(fed)) == len(fed) == 6 + 9 + 4 + 10, "forces, positions, valves, and track with wind"
    names = [one.name for one in root.connectors]
    assert len(set(names)) == len(names)
    assert not [name for name in names if "." in name]


def test_it_rides_as_both_do_when_they_are_coupled_directly(
    system, isolated, spring_fmus, car_fmus, tmp_path
):
    """The direct coupling passes no accelerations. They improve the extrapolation, and change 6e-4 of a range."""
    time = STEP * np.arange(1500)
    w = 2 * np.pi * 1.4
    driven = np.stack(
        [
            2e4 * np.sin(3.0 * time) ** 2,
            *(4e-3 * np.sin(w * time), 6e-3 * np.sin(w * time)),
            *(4e-3 * w * np.cos(w * time), 6e-3 * w * np.cos(w * time)),
        ],
        axis=1,
    )
    same = np.array(step(system, tmp_path, driven, without="_acceleration"))
    found = np.array(step(system, tmp_path, driven))
    mass = float(load().record.nominal_preload.sum() / load().record.gravity)
    to = tmp_path / "ridden.npy"
    given = {"strange": False, "car": str(car_fmus[2]), "mass": mass, "step": STEP, "share": 0.0}
    isolated(spring_fmus[2], "ride", driven=driven, to=str(to), **given)
    right = np.load(to)
    assert np.ptp(right, axis=0).min() > 1e-3
    assert equal(same, right, 1e-12)
    assert equal(found, right, 2e-3)


def step(system, folder, driven, *, without=None):
    """Simulate by the connections of the file, but for inputs that end ``without``; outputs (n, FELT) after steps."""
    fmus, root = fmus_of(system, folder), read_ssd(str(system)).system
    running, place = {}, {}
    for component in root.elements:
        described = fmus[component.name]
        place[component.name] = {one.name: one.valueReference for one in described.modelVariables}
        running[component.name] = fmu = FMU2Slave(
            guid=described.guid,
            unzipDirectory=fmpy.extract(folder / component.source, unzipdir=folder / component.name),
            modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName=component.name,
        )
        fmu.instantiate()
        fmu.setupExperiment()
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
    rows = []
    for n, row in enumerate(driven):
        outside = dict(zip(DRIVEN, row, strict=True))
        moved = []
        for start, end in get_connections(root):
            if start.parent is not root:
                value = running[start.parent.name].getReal([place[start.parent.name][start.name]])[0]
            else:
                value = outside.get(start.name, 0.0)
            moved.append((end, value))
        for end, value in moved:
            if end.parent is not root and not (without and end.name.endswith(without)):
                running[end.parent.name].setReal([place[end.parent.name][end.name]], [value])
        for fmu in running.values():
            fmu.doStep(currentCommunicationPoint=n * STEP, communicationStepSize=STEP)
        ends = {end.name: start for start, end in get_connections(root) if end.parent is root}
        rows.append(
            [
                running[one.parent.name].getReal([place[one.parent.name][one.name]])[0]
                for one in map(ends.get, FELT)
            ]
        )
    for fmu in running.values():
        fmu.freeInstance()
    return rows


def test_another_tool_simulates_it(system, tmp_path):
    """FMPy starts all connectors at 0, so the car falls for one step; the lean in constant wind is that of `step`."""
    wind = 1e4
    told = simulate_ssp(str(system), stop_time=4.0, step_size=STEP, input={"car_wind": lambda time: wind})
    driven = np.zeros((4000, 5))
    driven[:, 0] = wind
    right = step(system, tmp_path, driven)[-1][FELT.index("car_lean")]
    assert told["car_lean"][-1] == pytest.approx(right, rel=0.02)
