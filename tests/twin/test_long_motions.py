"""Motions without a rest are judged in stretches that go on from one another, so that a look stays cheap."""

from itertools import pairwise

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from bench_records.record import Record, read
from bench_sim.parameters import load
from bench_sim.rig.faults.panel import PlannedFault
from bench_sim.rig.rig import Rig
from diagnosis.twin.stretches import BEGINNING, LONG, LONGEST, STEP, Stretch, stretches
from diagnosis.twin.twin import Seen, Twin
from test_plans.discovery import plans
from test_plans.execution import execute
from tests.twin.test_twin import Growing

pytestmark = pytest.mark.slow


def cycled(folder, seed: int, cycles: int, *faults: PlannedFault) -> Record:
    """The record of an endurance run that does not rest once."""
    values = {"cycles": str(cycles), "frequency": "0.9 Hz", "amplitude": "10 mm", "intervals": "1"}
    rig = Rig(load("astb"), seed=seed)
    for fault in faults:
        rig.faults.plan(fault)
    with RigInMemory(rig).bench(seed=seed) as bench:
        execute(plans()["endurance"].given(values), bench, folder, rig="virtual", seed=seed)
    return read(folder)


class Remembering(Twin):
    """A twin that remembers what it has seen."""

    seen: list[Seen]

    def _see(self, stretch: Stretch, end: float, before: Seen | None = None) -> Seen:
        self.seen.append(super()._see(stretch, end, before))
        return self.seen[-1]


def looked_at_piece_by_piece(record: Record) -> list[Stretch]:
    """The stretches of a record as a twin finds them that goes on from what it has found before."""
    growing, since, found = Growing(record), BEGINNING, []
    for growing.until in np.append(np.arange(8.0, record.duration, 2.3), np.inf):
        until = found[-1].end if found else 0.0
        last = np.isinf(growing.until)
        fresh = stretches(growing, ended=bool(last), since=since)
        found += [one for one in fresh if one.start > until - 0.5 * STEP and not one.open]
        if not last and fresh[-1].sure:
            since = fresh[-1]
    return found


def test_a_long_motion_is_judged_in_stretches_that_go_on_from_one_another(tmp_path):
    record = cycled(tmp_path / "run", 31, 240)
    cut = [one for one in stretches(record) if not one.why]
    assert sum(one.moving for one in cut) >= 2
    assert all(one.end - one.start < LONGEST + LONG for one in cut)
    assert all(after.start == pytest.approx(before.end) for before, after in pairwise(cut))
    assert looked_at_piece_by_piece(record) == stretches(record)
    twin = Remembering(record, load("astb"), "astb")
    twin.seen = []
    story = twin.look()
    assert not story.all_deviations
    assert story.judged_for == pytest.approx(sum(one.end - one.start for one in cut))
    moving = [one for one in twin.seen if one.gas]
    assert moving
    for one in moving:
        known = one.columns.samples.all(axis=1)
        pressures = [k for k, channel in enumerate(one.channels) if channel.name.endswith("_pressure")]
        errors = (one.columns.measured - one.columns.simulated)[known][:, pressures]
        # The mean of a thermometer for the gas of a moment would leave 7 kPa, and zeros of sensors are known by then.
        assert len(pressures) == 4
        assert np.all(np.abs(errors - errors.mean(axis=0)) < 0.8e3)
        assert np.all(np.abs(errors.mean(axis=0)) < 2.5e3)


def test_a_cause_that_starts_during_a_long_motion_is_named(tmp_path):
    leak = PlannedFault("leak", {"side": "right", "area": "0.3mm2"}, 165.0, None)
    record = Growing(cycled(tmp_path / "run", 32, 200, leak))
    twin = Twin(record, load("astb"), "astb")
    record.until = 160.0
    assert not twin.look(ended=False).all_deviations
    record.until = 185.0
    assert any(one.moving and one.start < 160.0 and one.open for one in stretches(record, ended=False))
    (parting,) = twin.look(ended=False).all_deviations
    found = next(one for one in parting.causes if one.name == "leak.right")
    assert found.low < 0.3e-6 < found.high
    assert parting.since == pytest.approx(165.0, abs=1.0)
