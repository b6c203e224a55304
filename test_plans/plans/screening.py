"""Screening: motions that excite every effect of the springs, with other amplitudes in every stretch."""

from __future__ import annotations

from typing import Final

from bench_protocol.units import Hz, mm, mrad, s
from test_plans.loads import AW0, AW3
from test_plans.programmes.motions import Part, Programme, RestPose, Segment, Stretch, Wave
from test_plans.programmes.perform import programme_plan

#: Five cycles at full amplitude, each a whole number of samples: what differs between them is noise.
REPEATED: Final = (1.25 * Hz, 7)


def medley(
    *,
    start: RestPose,
    slow: float,
    large: float,
    middle: float,
    quick: float,
    fast: float,
    step: float,
    shear: float,
    wide: float,
    roll: float,
) -> Stretch:
    """Return a stretch of different motions of about a minute. Amplitudes are in m (``roll`` in rad), ``step`` is
    relative to the start height.
    """
    segments: tuple[Segment, ...] = (
        Wave("vertical", slow, 0.3 * Hz, 3, "triangle"),
        Wave("vertical", large, 0.5 * Hz, 3),
        Wave("vertical", middle, *REPEATED),
        Wave("vertical", quick, 3.125 * Hz, 9),
        Wave("vertical", fast, 8 * Hz, 18),
        RestPose(start.height + step, start.shear, start.roll, rest=8 * s),
        start,
        Wave("lateral", wide, 0.25 * Hz, 3, "triangle"),
        Wave("lateral", shear, 1 * Hz, 4),
        Wave("roll", roll, 0.5 * Hz, 3),
    )
    return Stretch(segments, start)


STRETCHES: Final = (
    medley(
        start=RestPose(),
        slow=5 * mm,
        large=8 * mm,
        middle=4 * mm,
        quick=1.5 * mm,
        fast=0.5 * mm,
        step=8 * mm,
        shear=5 * mm,
        wide=12 * mm,
        roll=8 * mrad,
    ),
    medley(
        start=RestPose(height=8 * mm, roll=-4 * mrad),
        slow=8 * mm,
        large=4 * mm,
        middle=6 * mm,
        quick=2.5 * mm,
        fast=0.8 * mm,
        step=-10 * mm,
        shear=8 * mm,
        wide=30 * mm,
        roll=5 * mrad,
    ),
    medley(
        start=RestPose(height=-8 * mm, shear=5 * mm, roll=3 * mrad),
        slow=3 * mm,
        large=10 * mm,
        middle=2 * mm,
        quick=2 * mm,
        fast=1.0 * mm,
        step=6 * mm,
        shear=3 * mm,
        wide=20 * mm,
        roll=12 * mrad,
    ),
)

SCREENING: Final = Programme(
    "screening",
    "Screening: small motions of many kinds under both loads, to find errors of a model of the springs.",
    (Part(AW0, STRETCHES), Part(AW3, STRETCHES)),
    """
    Under the empty and under the full car, with all valves shut and the differential pressure valve isolated, the bench
    makes three series of motions of about a minute each. A series begins at another height, shear and roll. Large
    cycles remove the effect of earlier motion on the friction. Slow triangles, sines from 0.25 to 8 Hz, a step that is
    held, lateral and roll motion follow, in other sizes each time. One cycle is repeated five times, to measure noise.

    Nothing is judged here: `astb diagnose` compares the record with the model.
    """,
)

screening: Final = programme_plan(SCREENING)
