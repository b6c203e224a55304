"""The vehicle's parameter file and its refusals."""

import re
from pathlib import Path

import numpy as np
import pytest

import bench_sim.parameters
from bench_sim.model.car import CAR, CAR_QUANTITIES
from bench_sim.parameters import PROVENANCES, ParameterError
from bench_sim.parameters.vehicle import load_vehicle
from tests.refusals import refuses

FILE = Path(bench_sim.parameters.__file__).parent / "vehicle.toml"


def test_every_quantity_has_value_source_and_provenance():
    car = load_vehicle()
    assert set(car.entries) == {q.name for q in CAR_QUANTITIES} == set(CAR.names)
    assert all(entry.source and entry.provenance in PROVENANCES for entry in car.entries.values())
    assert car.record.damper_rate == 30e3
    assert car.record.train_speed == pytest.approx(100 / 3.6)
    assert car.record.bump_stop_travel[0] == pytest.approx(0.025)


def test_changes_are_checked_and_leave_the_original():
    car = load_vehicle()
    assert car.with_values(anti_roll_stiffness=0).record.anti_roll_stiffness == 0
    assert car.record.anti_roll_stiffness == 940e3
    with pytest.raises(
        ParameterError, match=re.escape("damper_rate = -1 kN*s/m is outside 0 to 1000 kN*s/m")
    ):
        car.with_values(damper_rate=-1e3)
    with refuses(ParameterError, "'damper_rate'"):
        car.with_values(damper_rat=1.0)
    with refuses(ParameterError, "increase"):
        car.with_values(bump_stop_travel=np.zeros(9))
    with refuses(ParameterError, "shape"):
        car.with_values(bump_stop_force=np.zeros(3))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"kN*s/m"', '"kN/m"', "wrong unit"),
        ("damper_knee", "damper_kneee", "did you mean 'damper_knee'?"),
        ("[damper]", "[damper]\nfloor_depth = 1", "occurs twice"),
        ("[body]", "floor = 1\n[body]", "outside a section"),
        ("[body]", "[body", "line 5, .*: a bracket is not closed"),
    ],
)
def test_a_broken_file_is_refused_by_name(tmp_path, old, new, message):
    file = tmp_path / "tram.toml"
    file.write_text(FILE.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ParameterError, match=rf"tram\.toml.*: .*{message}"):
        load_vehicle(file)


def test_a_missing_file_or_entry_is_named(tmp_path):
    with refuses(ParameterError, "'tram'"):
        load_vehicle("tram")
    file = tmp_path / "tram.toml"
    lines = FILE.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join(line for line in lines if not line.startswith("wind_height")), encoding="utf-8")
    with refuses(ParameterError, "wind_height"):
        load_vehicle(file)
