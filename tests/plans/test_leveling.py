"""Leveling: information of the stairs about a valve, and limits that a valve that never opens would pass."""

from dataclasses import replace
from math import hypot, sqrt
from types import SimpleNamespace

import pytest

from bench_protocol.units import mm, s
from test_plans.analysis.uncertainty import Measured
from test_plans.loads import Band, SpecimenError
from test_plans.plans.leveling import _dead_band, _opened, lift
from test_plans.specimen import ordinary


def exactly(evaluate, *read, **_):
    """What a run with perfect instruments measures."""
    return Measured(evaluate(*read), 0.0)


RUN = SimpleNamespace(measured=exactly)


def stairs(*heights):
    return [{"left.height": height * mm} for height in heights]


def test_a_valve_opens_in_the_middle_of_two_stairs_give_or_take_half_of_what_is_between():
    fine, coarse = (_opened(RUN, "left", 1.0, stairs(*two)) for two in ((4.0, 4.5), (0.0, 2.0)))
    assert (fine.value, coarse.value) == pytest.approx((4.25 * mm, 1.0 * mm))
    assert (fine.u, coarse.u) == pytest.approx((0.25 * mm / sqrt(3), 1.0 * mm / sqrt(3)))
    band = _dead_band(RUN, "left", stairs(4.0, 4.5, 0.0, -2.0))
    assert band.value == pytest.approx(5.25 * mm)
    assert band.u == pytest.approx(hypot(0.25, 1.0) * mm / sqrt(3))
    assert band.even == pytest.approx(1.0 * mm / sqrt(3))


@pytest.mark.parametrize(
    ("limit", "band", "right"),
    [
        ("leveling_opening", Band(3 * mm, 10 * mm), "give an upper limit of 8 mm at most"),
        ("leveling.dead_band", Band(7 * mm, None), "give an upper limit of 16 mm at most"),
        ("leveling_fill_time", Band(14 * s, None), "give an upper limit"),
    ],
)
def test_limits_by_which_a_valve_that_never_opens_would_pass_are_refused(limit, band, right):
    spring = ordinary()
    limits = replace(spring.limits, bands={**spring.limits.bands, limit: band})
    with pytest.raises(SpecimenError, match=f"{limit} would pass a valve that does not open; {right}"):
        lift(SimpleNamespace(specimen=replace(spring, limits=limits)), within=60 * s)
