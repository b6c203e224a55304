"""A minute of the soak at full rate, with faults on and off: no frame is missing or wrong, and no queue grows."""

import pytest

from astb_studies.benchmarks.soak import judged, soak


@pytest.mark.slow
@pytest.mark.real_time
@pytest.mark.timeout(300)
def test_a_minute() -> None:
    seen, sizes = soak(1.0)
    assert judged(seen, sizes) == []
    assert seen.faults >= 2
