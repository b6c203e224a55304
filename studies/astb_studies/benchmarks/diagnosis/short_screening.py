"""The screening of the benchmark: six runs of twenty seconds that show nearly every effect of the catalogue.

It is short because the cost of a case grows with its samples, and rates need a thousand cases. The minutes of the plan
`screening` are done once here, with fewer cycles. Three runs have the differential pressure valve connected, so that
its leak shows. The leveling valves stay shut: if one opens, a step of 2.5 ms is too coarse, and the diagnosis of
healthy benches reported a wrong dead zone.
"""

from typing import Final

from bench_protocol.units import Hz, mm, mrad, s
from test_plans.loads import AW0, AW3
from test_plans.plan import Plan
from test_plans.plans.screening import SCREENING
from test_plans.programmes.motions import Part, Programme, RestPose, Segment, Stretch, Valves, Wave
from test_plans.programmes.perform import programme_plan

#: As many cycles as in the plan, but faster. With four cycles, the load cells still measured 3 N from the history of
#: friction, and the form of the model alone caused a λ of up to 40.
_WIPE: Final = (Wave("vertical", 10 * mm, 2 * Hz, 5), Wave("lateral", 10 * mm, 2 * Hz, 6))
_CONNECTED: Final = Valves(air="hold", reservoirs="on", dpv="on")
_ISOLATED: Final = Valves(air="hold", reservoirs="on", dpv="off")


def _medley(
    start: RestPose,
    step: float,
    sizes: tuple[float, float, float],
    shear: tuple[float, float],
    roll: float,
    valves: Valves,
) -> Stretch:
    """Return a run of twenty seconds; ``sizes`` of slow, middle and quick vertical waves (m), ``shear`` with its Hz."""
    slow, middle, quick = sizes
    segments: tuple[Segment, ...] = (
        Wave("vertical", slow, 1 * Hz, 3, "triangle"),
        Wave("vertical", middle, 2 * Hz, 5),
        Wave("vertical", quick, 8 * Hz, 12),
        RestPose(start.height + step, start.shear, start.roll, rest=1.5 * s),
        start,
        Wave("lateral", *shear, 3),
        Wave("roll", roll, 1.5 * Hz, 3),
    )
    return Stretch(segments, start, _WIPE, valves)


_LOW: Final = RestPose(height=-8 * mm, shear=5 * mm, roll=3 * mrad)
_HIGH: Final = RestPose(height=8 * mm, roll=-4 * mrad)

PROGRAMME: Final = Programme(
    SCREENING.name,
    "Short screening: six runs of twenty seconds.",
    (
        Part(
            AW0,
            (
                _medley(_LOW, -6 * mm, (5 * mm, 6 * mm, 0.5 * mm), (20 * mm, 0.75 * Hz), 4 * mrad, _ISOLATED),
                _medley(
                    RestPose(), 8 * mm, (6 * mm, 4 * mm, 0.6 * mm), (8 * mm, 1.5 * Hz), 8 * mrad, _ISOLATED
                ),
                _medley(
                    _HIGH, -10 * mm, (8 * mm, 3 * mm, 0.8 * mm), (28 * mm, 0.75 * Hz), 6 * mrad, _CONNECTED
                ),
            ),
        ),
        Part(
            AW3,
            (
                _medley(
                    RestPose(), 8 * mm, (6 * mm, 4 * mm, 0.6 * mm), (8 * mm, 1.5 * Hz), 8 * mrad, _ISOLATED
                ),
                _medley(
                    _HIGH, -10 * mm, (8 * mm, 3 * mm, 0.8 * mm), (28 * mm, 0.75 * Hz), 6 * mrad, _CONNECTED
                ),
                _medley(
                    _LOW, 6 * mm, (4 * mm, 5 * mm, 0.7 * mm), (26 * mm, 0.75 * Hz), 10 * mrad, _CONNECTED
                ),
            ),
        ),
    ),
    "Nothing is judged here.",
)


def short_screening() -> Plan:
    """Return the plan; its record is used as that of a screening, with roles assigned to its runs."""
    return programme_plan(PROGRAMME)
