"""Causes of one spring and of one sensor that begin in the middle of a run are named, with size and beginning."""

import numpy as np
import pytest

from bench_records.record import read
from bench_sim.parameters import load
from bench_sim.rig.faults.panel import PlannedFault
from diagnosis.twin.twin import Twin
from tests.twin.test_twin import Growing, run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plan", "began", "fault", "values", "cause", "size"),
    [
        ("aw0", 68.0, "blocked_orifice", {"side": "left", "share": "30%"}, "blocked_orifice.left", 0.3),
        (
            "screening",
            100.0,
            "blocked_orifice",
            {"side": "right", "share": "50%"},
            "blocked_orifice.right",
            0.5,
        ),
        ("aw0", 62.0, "bias", {"sensor": "load_cell.2", "value": "0.3kN"}, "cell_offset.2", 300.0),
        ("aw0", 62.0, "bias", {"sensor": "load_cell.5", "value": "-150N"}, "cell_offset.5", -150.0),
    ],
)
def test_what_one_side_or_one_cell_has_is_named(tmp_path, plan, began, fault, values, cause, size):
    folder = run(plan, tmp_path, 31, PlannedFault(fault, values, began, None))
    growing = Growing(read(folder))
    growing.until = began + 40.0
    first, *_ = Twin(growing, load("astb"), "astb").look().all_deviations
    assert {one.name for one in first.causes} == {cause}
    (found,) = first.causes
    assert found.low <= size <= found.high
    assert found.high - found.low < 0.25 * abs(size)
    assert first.earliest - 1.0 <= began <= first.latest + 1.0
    assert np.sign(found.size) == np.sign(size)
