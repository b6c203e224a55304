"""Simulates FMUs where this project cannot be imported: `python -I -S alone.py PACKAGES FMU WHAT [FILE]`.

It answers in JSON. Without `site` no path of an editable installation is followed; FMPy and numpy come from PACKAGES.
"""

import json
import sys
from importlib.util import find_spec

sys.path.append(sys.argv[1])

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

assert not any(map(find_spec, ("bench_sim", "diagnosis", "astb"))), "this project is installed here"

OUTPUTS = (
    *("left.vertical_force", "right.vertical_force", "left.lateral_force", "right.roll_moment"),
    *("left.bellows_pressure", "left.auxiliary_pressure", "left.bellows_temperature"),
    *("left.orifice_flow", "left.leveling_flow"),
)


class Unit:
    """One instance, whatever version it has."""

    def __init__(self, path, folder, description, name="springs", said=None):
        self.two = description.fmiVersion == "2.0"
        self.number = {one.name: one.valueReference for one in description.modelVariables}
        kind = FMU2Slave if self.two else FMU3Slave
        self.unit = kind(
            guid=description.guid if self.two else description.instantiationToken,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.said = [] if said is None else said
        if self.two:
            from fmpy.fmi2 import (
                calloc,
                fmi2CallbackAllocateMemoryTYPE,
                fmi2CallbackFreeMemoryTYPE,
                fmi2CallbackFunctions,
                fmi2CallbackLoggerTYPE,
                free,
            )

            self.calls = fmi2CallbackFunctions()
            self.calls.logger = fmi2CallbackLoggerTYPE(lambda *given: self.said.append(given[4].decode()))
            self.calls.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
            self.calls.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
            self.unit.instantiate(callbacks=self.calls)
        else:
            from fmpy.fmi3 import fmi3LogMessageCallback

            self.log = fmi3LogMessageCallback(lambda *given: self.said.append(given[3].decode()))
            self.unit.instantiate(logMessage=self.log)

    def set(self, values):
        put = self.unit.setReal if self.two else self.unit.setFloat64
        put([self.number[name] for name in values], list(values.values()))

    def get(self, *names):
        take = self.unit.getReal if self.two else self.unit.getFloat64
        return [float(one) for one in take([self.number[name] for name in names])]

    def begin(self, time=0.0):
        if self.two:
            self.unit.setupExperiment(startTime=time)
            self.unit.enterInitializationMode()
        else:
            self.unit.enterInitializationMode(startTime=time)

    def ready(self):
        self.unit.exitInitializationMode()

    def step(self, time, length):
        self.unit.doStep(currentCommunicationPoint=time, communicationStepSize=length)

    def save(self):
        if self.two:
            state = self.unit.getFMUstate()
            return self.unit.serializeFMUstate(state)
        state = self.unit.getFMUState()
        return self.unit.serializeFMUState(state)

    def restore(self, saved):
        if self.two:
            self.unit.setFMUstate(self.unit.deSerializeFMUstate(saved))
        else:
            self.unit.setFMUState(self.unit.deserializeFMUState(saved))

    def refused(self, act, *given):
        """Return what it said when it refused ``act``."""
        before = len(self.said)
        try:
            act(*given)
        except Exception:
            return self.said[before:]
        return "not refused"


def moved(unit, times, given, names, outputs, *, saved_at=None, other=None):
    """Step from time to time; ``given`` (n, names) is put before each step. Returns outputs after each."""
    rows = []
    for n in range(len(times) - 1):
        if n == saved_at:
            kept = unit.save()
            unit = other
            unit.restore(kept)
        unit.set(dict(zip(names, given[n], strict=True)))
        unit.step(times[n], times[n + 1] - times[n])
        rows.append(unit.get(*outputs))
    return rows


def motion(fresh, running):
    """Move as given, twice: the second time with another instance from the middle on."""
    given = np.load(sys.argv[4])
    names, times = [str(one) for one in given["names"]], given["times"]
    outputs = [str(one) for one in given["outputs"]] if "outputs" in given else OUTPUTS
    begun = {}
    if "begin" in given:
        begun = dict(zip(map(str, given["begin"]), given["begin_values"].tolist(), strict=True))
    first, second = running(begun), running(begun)
    whole = moved(first, times, given["motion"], names, outputs)
    half = len(times) // 2
    again = moved(second, times, given["motion"], names, outputs, saved_at=half, other=running())
    return {"outputs": whole, "again": again}


def many(fresh, running):
    units = [fresh(name=f"spring {k}") for k in range(100)]
    for k, unit in enumerate(units):
        unit.begin()
        unit.set({"left.nominal_preload": 40e3 + 100.0 * k})
        unit.ready()
    for n in range(20):
        for unit in units:
            unit.set({"left.height": 1e-3 * n, "left.height_speed": 0.1})
            unit.step(5e-3 * n, 5e-3)
    forces = [unit.get("left.vertical_force")[0] for unit in units]
    isolated = fresh()
    isolated.begin()
    isolated.set({"left.nominal_preload": 40e3 + 100.0 * 63})
    isolated.ready()
    for n in range(20):
        isolated.set({"left.height": 1e-3 * n, "left.height_speed": 0.1})
        isolated.step(5e-3 * n, 5e-3)
    for unit in units:
        unit.unit.freeInstance()
    return {"forces": forces, "alone": isolated.get("left.vertical_force")[0]}


def remainder(fresh, running):
    unit, even = running(), running()
    for one in (unit, even):
        one.set({"left.height_speed": 0.02})
    for n in range(100):  # 100 times 0.3 ms
        unit.step(3e-4 * n, 3e-4)
        unit.set({"left.height": 0.02 * 3e-4 * (n + 1)})
    even.step(0.0, 30e-3)
    return {"parts": unit.get(*OUTPUTS), "whole": even.get(*OUTPUTS)}


def refusals(fresh, running):
    unit = running()
    nan = float("nan")
    answers = {
        "range": unit.refused(unit.set, {"left.effective_area": 3.0}),
        "kept": unit.get("left.effective_area"),
        "nan": unit.refused(unit.set, {"left.height": nan}),
        "output": unit.refused(unit.set, {"left.vertical_force": 1.0}),
        "fixed": unit.refused(unit.set, {"emergency_spring": 1.0}),
        "order": [],
    }
    before = unit.get(*OUTPUTS)
    unit.set({"left.height": -0.3})
    answers["deep"] = unit.refused(unit.step, 0.0, 1e-3)
    unit.set({"left.height": 0.0})
    unit.step(0.0, 1e-3)
    answers["goes on"] = [abs(a - b) for a, b in zip(unit.get(*OUTPUTS), before, strict=True)]
    answers["time"] = unit.refused(unit.step, 0.5, 1e-3)
    answers["backwards"] = unit.refused(unit.step, 1e-3, -1e-3)
    unit.set({"dpv_reclosing": 5e5})
    answers["order"] = unit.refused(unit.step, 1e-3, 1e-3)
    unit.set({"dpv_reclosing": 1e5, "left.leak_conductance": 1e-7, "left.height": 0.01})
    for n in range(1, 12000):
        unit.step(1e-3 * n, 1e-3)
    answers["empty"] = unit.get("left.bellows_pressure")[0]
    unit.set({"left.leak_conductance": 0.0, "left.height": 0.3})
    answers["vacuum"] = unit.refused(unit.step, 12.0, 1e-3)
    answers["state"] = unit.refused(unit.restore, b"nonsense")
    return answers


#: Exchanged variables of springs and car, by the names of each: first ours, then those of `models/RidingCar.py`.
FORCES = {
    "left.vertical_force": "F_left",
    "right.vertical_force": "F_right",
    "left.lateral_force": "S_left",
    "right.lateral_force": "S_right",
    "left.roll_moment": "M_left",
    "right.roll_moment": "M_right",
}
PLACES = {
    "left.height": "h_left",
    "right.height": "h_right",
    "springs.lateral": "shear",
    "left.height_speed": "h_left_rate",
    "right.height_speed": "h_right_rate",
    "springs.lateral_speed": "shear_rate",
}
#: Wind, and the track with its speed, each sideways and up; then what the floor does.
DRIVES = {
    "car.wind": "wind",
    "track.lateral": "y_track",
    "track.vertical": "z_track",
    "track.lateral_speed": "v_track",
    "track.vertical_speed": "w_track",
}
FELT = {"car.acceleration": "a_floor", "car.rising": "a_up", "car.bump_stop": "stop", "car.lean": "lean"}


def ride(fresh, running):
    """Run a car on the springs in common steps; both are FMUs.

    The springs go first, to where the car's speeds lead; what the car feels are their forces between both ends.
    """
    given = np.load(sys.argv[4])
    place = 1 if given["strange"] else 0
    forces, places, drives, felt = (
        [pair[place] for pair in one.items()] for one in (FORCES, PLACES, DRIVES, FELT)
    )
    springs, car = running(), opened(str(given["car"]))()
    car.begin()
    car.set({"mass": float(given["mass"])})
    car.ready()
    step, share = float(given["step"]), float(given["share"])
    before, stands = springs.get(*FORCES), car.get(*places)
    rows = []
    for n, driven in enumerate(given["driven"].tolist()):
        springs.set(dict(zip(PLACES, stands, strict=True)))
        springs.step(n * step, step)
        after = springs.get(*FORCES)
        mean = [one + share * (other - one) for one, other in zip(before, after, strict=True)]
        car.set(dict(zip([*forces, *drives], [*mean, *driven], strict=True)))
        car.step(n * step, step)
        before, stands = after, car.get(*places)
        rows.append(car.get(*felt))
    np.save(str(given["to"]), rows)
    return {"steps": len(rows)}


def bench_refusals(fresh, running):
    unit = running()
    heights = unit.get("left.height", "right.height")
    for n in range(50):
        unit.step(0.02 * n, 0.02)
    return {
        "mode": unit.refused(unit.set, {"vertical_left.control": 1.5}),
        "range": unit.refused(unit.set, {"platform.roll_setpoint": 1.0}),
        "fixed": unit.refused(unit.set, {"left.nominal_preload": 5e4}),
        "rest": max(
            abs(a - b) for a, b in zip(unit.get("left.height", "right.height"), heights, strict=True)
        ),
    }


def cars(fresh, running):
    """A hundred cars of different masses, and one that goes by parts of a tick."""

    def ride(units, steps, length):
        for n in range(steps):
            for unit in units:
                unit.set({"car.wind": 3e4})
                unit.step(length * n, length)
        return [unit.get("car.lateral")[0] for unit in units]

    units = [running({"mass": 1e4 + 10.0 * k}, name=f"car {k}") for k in range(100)]
    places = ride(units, 20, 5e-3)
    (isolated,) = ride([running({"mass": 1e4 + 630.0})], 20, 5e-3)
    (parts,) = ride([running()], 100, 3e-4)
    (whole,) = ride([running()], 1, 30e-3)
    for unit in units:
        unit.unit.freeInstance()
    return {"places": places, "alone": isolated, "parts": parts, "whole": whole}


def car_refusals(fresh, running):
    unit = running()
    answers = {
        "mass": unit.refused(unit.set, {"mass": 0.0}),
        "spacing": unit.refused(unit.set, {"spring_half_spacing": 1.0}),
    }
    before = unit.get("car.lateral", "car.lean")
    unit.set({"bump_stop_travel[2]": 0.01})
    answers["stop"] = unit.refused(unit.step, 0.0, 1e-3)
    unit.set({"bump_stop_travel[2]": 0.03, "track.lateral": 1e308, "bump_stop_force[9]": 1e7})
    answers["far"] = unit.refused(unit.step, 0.0, 1e-3)
    answers["kept"] = [before, unit.get("car.lateral", "car.lean")]
    return answers


def opened(path):
    """Return what makes instances of an FMU."""
    description = fmpy.read_model_description(path, validate=True)
    folder = fmpy.extract(path)
    return lambda **more: Unit(path, folder, description, **more)


def main():
    path, what = sys.argv[2:4]
    if what == "validate":
        from fmpy.validation import validate_fmu

        version = fmpy.read_model_description(path, validate=True).fmiVersion
        return {"problems": validate_fmu(path), "version": version}
    fresh = opened(path)

    def running(begun=None, **more):
        unit = fresh(**more)
        unit.begin()
        if begun:
            unit.set(begun)
        unit.ready()
        return unit

    return globals()[what](fresh, running)


print("ANSWER", json.dumps(main()))
