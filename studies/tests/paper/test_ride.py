"""The ride of a computed car on the springs of the virtual rig agrees with the ride on the model's springs."""

from dataclasses import replace

import numpy as np
import pytest

from astb_studies.paper.hybrid import coupling
from astb_studies.paper.plans.ride import RUN_IN, WIND_STEP, wind_force
from bench_protocol.named_files import place_of
from bench_records.result import Outcome
from bench_sim.model.car import RideChannel
from bench_sim.model.vehicle import Vehicle
from bench_sim.parameters import load as parameters
from bench_sim.parameters.vehicle import load_vehicle
from test_plans.instruments import ordinary
from test_plans.specimen import PACKAGE
from test_plans.steps.wind import RISE

#: Of the acceleration; the plan's own uncertainty is smaller.
AGREES = 0.03
ACCELERATION = "acceleration against the simulation, E_n"


COMFORT = {
    "comfort index N, lateral",
    "comfort index N, vertical",
    "comfort index N_MV, lateral and vertical",
}


def single_car(load, wind, duration, draw=1):
    """The same car in the same wind on the model's springs: a_y and a_z of the floor (rms), and its mean lean."""
    whole = duration + RUN_IN + RISE
    vehicle = Vehicle(parameters("astb", load).record, load_vehicle().record)
    ride = vehicle.ride(wind_force(wind, whole, draw)[1], whole, interval=WIND_STEP)
    counted = (ride.time >= RUN_IN) & (ride.time < RUN_IN + duration)
    a = ride.lateral_acceleration(0.6)[counted]
    rising = ride.of(RideChannel.VERTICAL_ACCELERATION)[counted]
    return float(a.std()), float(rising.std()), float(np.abs(ride.of(RideChannel.ROLL)[counted].mean()))


@pytest.mark.slow
@pytest.mark.parametrize(("load", "wind"), [("AW0", 10.0), ("AW3", 25.0)])
def test_it_rides_as_the_car_does_on_the_models_springs(judged, load, wind):
    given = {"load": load, "wind": f"{wind} m/s", "duration": "20 s"}
    result, failed = judged("ride", given=given, instruments=ordinary())
    found = {one.name: one for one in result.checks}
    assert not failed, result.reason
    assert result.verdict is Outcome.PASS
    assert not COMFORT & found.keys(), "comfort indices need five minutes"
    a, rising, lean = single_car(load, wind, 20.0)
    assert found["lateral acceleration of the floor, rms"].value == pytest.approx(a, rel=AGREES)
    assert found["vertical acceleration of the floor, rms"].value == pytest.approx(rising, rel=AGREES)
    assert abs(found["vertical acceleration against the simulation, E_n"].value) <= 1.0
    assert found["mean lean"].value == pytest.approx(lean, rel=AGREES)
    assert abs(found[ACCELERATION].value) <= 1.0
    assert {one.name for one in result.curves} == {"bench", "simulation"}


@pytest.mark.slow
@pytest.mark.parametrize(("model", "membrane"), [("mine.toml", 0.31), ("astb", 0.24)])
def test_springs_unknown_to_the_model_are_reported(judged, tmp_path, model, membrane):
    """A tenth less of the lateral law than in a model of these springs; a third less than in that of the drawing."""
    (tmp_path / "mine.toml").write_text('based_on = "astb"\n')
    specimen = tmp_path / "specimen.toml"
    drawing = place_of(PACKAGE, "astb").read_text()
    specimen.write_text(drawing.replace('\nmodel = "astb"\n', f'\nmodel = "{model}"\n'))
    given = {"load": "AW3", "wind": "25 m/s", "duration": "20 s"}
    how = {"instruments": ordinary(), "specimen": specimen, "membrane_length": membrane}
    _, failed = judged("ride", given=given, **how)
    assert "mean lean against the simulation, E_n" in failed or ACCELERATION in failed


@pytest.mark.slow
@pytest.mark.parametrize(("load", "wind"), [("AW0", 10.0), ("AW3", 20.0)])
def test_in_the_rigs_tick_springs_come_a_third_as_late(judged, load, wind):
    """And bench and simulation differ by no more than they may; how it rides is what the host's ride is."""
    given = {"load": load, "wind": f"{wind} m/s", "duration": "20 s", "by": "rig"}
    result, failed = judged("ride", given=given, instruments=ordinary())
    found = {one.name: one for one in result.checks}
    assert not failed, result.reason
    assert result.verdict is Outcome.PASS
    for what in ("acceleration", "vertical acceleration", "mean lean"):
        assert abs(found[f"{what} against the simulation, E_n"].value) <= 1.0
    a, rising, lean = single_car(load, wind, 20.0)
    assert found["lateral acceleration of the floor, rms"].value == pytest.approx(a, rel=AGREES)
    assert found["vertical acceleration of the floor, rms"].value == pytest.approx(rising, rel=AGREES)
    assert found["mean lean"].value == pytest.approx(lean, rel=AGREES)
    assert found["gain margin of the loop"].value > 20.0
    assert found["phase margin of the loop"].note.startswith(("14 ms late", "15 ms late"))


@pytest.mark.parametrize("by", ["host", "rig"])
def test_a_loop_without_margins_is_refused_before_anything_moves(judged, monkeypatch, by):
    monkeypatch.setitem(coupling.BEATS, by, replace(coupling.BEATS[by], latency=0.2))
    result, _ = judged("ride", given={"load": "AW0", "by": by})
    assert result.verdict is Outcome.BLOCKED
    assert "the loop of car, delay and springs is stable" in result.reason
    assert result.duration < 5.0
