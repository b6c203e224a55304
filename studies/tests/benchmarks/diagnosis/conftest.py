"""Something is hidden, measured, diagnosed and judged, in one call."""

import pytest

from astb_studies.benchmarks.diagnosis.campaign import Case, carry_out


@pytest.fixture
def judged():
    """Diagnose the case of a system, kind, condition and seed; return the result and its score."""
    return lambda *case, **given: carry_out(Case(*case), **given)
