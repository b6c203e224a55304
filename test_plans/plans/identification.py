"""Identification: the motions from which the parameters of unknown springs are reported, under both loads."""

from __future__ import annotations

from typing import Final

from bench_protocol.units import Hz, mm, mrad, s
from test_plans.loads import AW0, AW3
from test_plans.programmes.motions import Part, Programme, RestPose, Stretch, Valves, Wave
from test_plans.programmes.perform import programme_plan

#: Amplitudes and frequencies for orifice, volumes and friction; heights for heat transfer and area; shears up to the
#: bump stop for membrane and shell. Small motions come first on each axis, because friction depends on earlier, larger
#: motions.
WIDE: Final = Stretch(
    (
        Wave("vertical", 2 * mm, 3.125 * Hz, 9),
        Wave("vertical", 5 * mm, 1.25 * Hz, 5),
        Wave("vertical", 10 * mm, 0.5 * Hz, 3),
        RestPose(12 * mm, rest=6 * s),
        RestPose(-12 * mm, rest=6 * s),
        RestPose(),
        Wave("lateral", 5 * mm, 1 * Hz, 4),
        Wave("lateral", 20 * mm, 0.5 * Hz, 3),
        Wave("roll", 12 * mrad, 0.5 * Hz, 3),
    )
)
#: The same motions about a sheared and higher position.
ASIDE: Final = Stretch(
    (
        Wave("vertical", 0.8 * mm, 8 * Hz, 16),
        Wave("vertical", 6 * mm, 1 * Hz, 4),
        Wave("lateral", 8 * mm, 0.5 * Hz, 3),
        Wave("roll", 8 * mrad, 0.75 * Hz, 3),
    ),
    RestPose(height=5 * mm, shear=12 * mm),
)
#: The bellows alone, without the auxiliary volume.
ALONE: Final = Stretch(
    (
        Wave("vertical", 3 * mm, 1.25 * Hz, 5),
        Wave("vertical", 5 * mm, 0.5 * Hz, 3),
        Wave("lateral", 14 * mm, 0.5 * Hz, 3),
        Wave("roll", 10 * mrad, 0.5 * Hz, 3),
    ),
    valves=Valves(air="hold", reservoirs="off", dpv="off"),
)
STRETCHES: Final = (WIDE, ASIDE, ALONE)

IDENTIFICATION: Final = Programme(
    "identification",
    "Identification: determine the parameters of unknown springs in a few minutes.",
    (Part(AW0, STRETCHES), Part(AW3, STRETCHES)),
    """
    Under the empty and under the full car, and so at two pressures, the bench moves the springs up and down by several
    amplitudes and frequencies, holds them high and low, shears and rolls them; once about a place to the side, once
    with the auxiliary chambers shut off. No motion reaches the bump stop.

    This plan has no checks. `astb identify` makes a set of parameters from the record, and
    `astb identify --expect identification` predicts their uncertainty.
    """,
)

identification: Final = programme_plan(IDENTIFICATION)
