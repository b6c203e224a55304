"""The conformance suite on third-party rigs: both pass, and faults are found."""

import json
import subprocess
import sys
import tomllib

import pytest

from astb.acceptance.conformance.report import Outcome
from astb.acceptance.conformance.suite import examine_bench
from tests.foreign.machine import Valve
from tests.foreign.plc_rig import PlcRig, State
from tests.foreign.virtual import VirtualHall, VirtualPlc

STRANGE = {"plant_a": VirtualPlc, "hall_b": VirtualHall}


def examine(bench, motion=False):
    return {(one.group, one.what): one for one in examine_bench(bench, motion=motion, say=lambda text: None)}


@pytest.mark.parametrize(("name", "rate", "hold"), [("plant_a", 20, 1.1), ("hall_b", 100, 0.96)])
def test_a_strange_rig_is_found_sound_and_left_at_rest(name, rate, hold):
    with STRANGE[name]().bench() as bench:
        found = examine(bench, motion=True)
        assert bench.state == "DISABLED"
    assert not [one for one in found.values() if one.outcome is Outcome.WRONG]
    held = found["states", "HOLD after a new set-point: heights and displacements"]
    assert (held.outcome, held.value) == (Outcome.RIGHT, pytest.approx(0, abs=5e-4))
    assert found["signals", "left.height, rate"].value == pytest.approx(rate, rel=0.01)
    assert ("signals", "rig.program, rate") not in found, "the bench's own player is no rig"
    assert found["motion", "platform up by 2 mm"].value == pytest.approx(2e-3, abs=2e-4)
    assert found[
        "loss of commands", "time from the last command to the end of ACTIVE"
    ].value == pytest.approx(hold, abs=0.2)
    absent = found["values of signals", "lateral.acceleration"]
    assert (absent.outcome, absent.found) == (Outcome.SKIPPED, "absent: no accelerometer on the bolster")


def test_no_motion_without_permission():
    virtual = VirtualPlc()
    with virtual.bench() as bench:
        before = bench.platform.vertical
        found = examine(bench)
        assert bench.state == "DISABLED"
        assert bench.platform.vertical == pytest.approx(before, abs=1e-4)
    assert found["motion", "states, motion, loss of commands, next commander"].outcome is Outcome.SKIPPED


def test_a_bench_that_stays_active_without_commands_is_found_out(monkeypatch):
    with VirtualPlc().bench() as bench:
        monkeypatch.setattr(type(bench.commander), "stop", lambda commander: None)
        found = examine(bench, motion=True)
        monkeypatch.undo()
    assert (
        found["loss of commands", "time from the last command to the end of ACTIVE"].outcome is Outcome.WRONG
    )


class FollowsInHold(PlcRig):
    """Goes where set-points say as soon as it has power."""

    def _path(self):
        state = self.state
        try:
            self.state = State.RUN if state is State.READY else state
            return super()._path()
        finally:
            self.state = state


class FillsWhenArmed(PlcRig):
    """Keeps filling, as soon as it has air, after an order of an earlier client."""

    def _set(self):
        super()._set()
        if self.state in (State.READY, State.RUN):
            self.machine.valves, self.machine.targets = [Valve.FILL, Valve.FILL], [40e3, 40e3]


@pytest.mark.parametrize(
    ("spoilt", "broken"),
    [
        (FollowsInHold, "HOLD after a new set-point: heights and displacements"),
        (FillsWhenArmed, "ACTIVE without set-points: pressures"),
    ],
)
def test_a_rig_that_moves_by_itself_is_found_out(spoilt, broken):
    virtual = VirtualPlc()
    virtual.rig = spoilt(seed=1)
    with virtual.bench() as bench:
        found = examine(bench, motion=True)
    assert found["states", broken].outcome is Outcome.WRONG


@pytest.mark.parametrize("name", STRANGE)
def test_a_silent_rig_is_reported(name):
    virtual = STRANGE[name]()
    with virtual.bench() as bench:
        virtual.silent = True
        found = examine(bench)
    wrong = {what for (_, what), one in found.items() if one.outcome is Outcome.WRONG}
    assert wrong & {"all requests answered", "left.height, rate"}


@pytest.mark.slow
@pytest.mark.real_time
@pytest.mark.parametrize("name", STRANGE)
def test_the_command_knows_a_rig_with_a_wiring(started, tmp_path, name):
    with started(name) as (rig_file, _):
        command = [
            sys.executable,
            "-m",
            "astb",
            "rig",
            "conform",
            rig_file,
            "--allow-motion",
            "--json",
            "found.json",
        ]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (
        json.loads((tmp_path / "found.json").read_text())["rig"]
        == tomllib.loads(rig_file.read_text())["name"]
    )
