"""What the benchmark of virtual runs times is where it says: a part that nothing passes through has been renamed."""

from pathlib import Path

import pytest

from astb_studies.benchmarks.virtual import Meter, execute_plan


@pytest.mark.slow
def test_each_part_of_a_virtual_run_takes_a_part_of_its_time(tmp_path: Path) -> None:
    meter = Meter()
    simulated, elapsed = execute_plan("aw0", tmp_path, meter)
    assert simulated > 60.0
    assert all(spent > 0.0 for spent in meter.spent.values()), meter.spent
    # The record is fed from inside the drivers, and these from inside what passes frames on.
    assert meter.spent["record"] < meter.spent["drivers: frames"]
    assert sum(meter.spent.values()) - meter.spent["record"] < elapsed
