"""Identification: the motions from which the parameters of unknown springs are told, under both loads."""

from __future__ import annotations

from typing import Final

from bench_protocol.units import Hz, mm, mrad, s
from test_plans.loads import AW0, AW3
from test_plans.programmes.motions import Part, Programme, Stand, Stretch, Valves, Wave
from test_plans.programmes.perform import programme_plan

#: Orifice and volumes by amplitude and frequency, then heat and area by height.
UPRIGHT: Final = Stretch(
    (
        Wave("vertical", 10 * mm, 0.5 * Hz, 3),
        Wave("vertical", 5 * mm, 1.25 * Hz, 5),
        Wave("vertical", 2 * mm, 3.125 * Hz, 9),
        Wave("vertical", 0.8 * mm, 8 * Hz, 16),
        Stand(12 * mm, rest=8 * s),
        Stand(-12 * mm, rest=8 * s),
    )
)
#: Membrane, shell and friction by shear, up to before the bump stop; the area while sheared; then roll.
SIDEWAYS: Final = Stretch(
    (
        Wave("lateral", 20 * mm, 0.25 * Hz, 3),
        Wave("lateral", 5 * mm, 1 * Hz, 4),
        Stand(shear=20 * mm),
        Wave("vertical", 4 * mm, 0.5 * Hz, 3),
        Stand(),
        Wave("roll", 15 * mrad, 0.25 * Hz, 3),
    )
)
#: The bellows alone, which no auxiliary volume hides.
ALONE: Final = Stretch(
    (Wave("vertical", 6 * mm, 0.25 * Hz, 3), Wave("vertical", 3 * mm, 1.25 * Hz, 5)),
    valves=Valves(air="hold", reservoirs="off", dpv="off"),
)

IDENTIFICATION: Final = Programme(
    "identification",
    "Identification: what tells the parameters of unknown springs, in a few minutes.",
    (Part(AW0, (UPRIGHT, SIDEWAYS, ALONE)), Part(AW3, (UPRIGHT, SIDEWAYS))),
    """
    Under the empty and under the full car, and so at two pressures, the bench moves the springs up and down by several
    amplitudes and frequencies, holds them high and low, shears and rolls them; under the empty car also with the
    auxiliary chambers shut off. No motion reaches the bump stop.

    Nothing is judged here: `astb identify` makes a set of parameters of the record. How well each of them will be known
    is told beforehand by `astb identify --expect identification`.
    """,
)

identification: Final = programme_plan(IDENTIFICATION)
