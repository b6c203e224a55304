"""Separating runs: each distinguishes causes that have similar effects in the screening."""

from __future__ import annotations

from typing import Final

from bench_protocol.units import Hz, minutes, mm, mrad, s
from test_plans.loads import AW0, AW3
from test_plans.programmes.motions import Part, Programme, RestPose, Segment, Stretch, Valves, Wave
from test_plans.programmes.perform import programme_plan

LEVELING: Final = Valves(air="level", reservoirs="on", dpv="off")
DPV_CONNECTED: Final = Valves(air="hold", reservoirs="on", dpv="on")
ISOLATED: Final = Valves(air="hold", reservoirs="off", dpv="off")


def _programme(name: str, title: str, purpose: str, *parts: tuple[str, tuple[Stretch, ...]]) -> Programme:
    return Programme(name, title, tuple(Part(load, stretches) for load, stretches in parts), purpose)


def _single_stretch(
    *segments: Segment, start: RestPose | None = None, valves: Valves | None = None
) -> tuple[Stretch, ...]:
    plain = Stretch(segments)
    return (Stretch(segments, start or plain.start, valves=valves or plain.valves),)


_PROGRAMMES: Final = (
    _programme(
        "two_speed_loops",
        "Slow loops at two speeds and a large sine: friction of the rubber or its viscosity.",
        "Friction gives a loop of the same width at a tenth of the speed; viscosity gives a narrower one.",
        (
            AW0,
            (
                *_single_stretch(
                    Wave("vertical", 8 * mm, 0.05 * Hz, 3, "triangle"),
                    Wave("vertical", 8 * mm, 0.5 * Hz, 4, "triangle"),
                    Wave("vertical", 12 * mm, 0.5 * Hz, 4),
                ),
                *_single_stretch(
                    Wave("lateral", 12 * mm, 0.05 * Hz, 3, "triangle"),
                    Wave("lateral", 12 * mm, 0.5 * Hz, 4, "triangle"),
                    Wave("lateral", 18 * mm, 0.5 * Hz, 4),
                ),
            ),
        ),
    ),
    _programme(
        "holds_at_heights",
        "Holds at two heights under both loads: leak, heat or drift.",
        "Heat exchange ends, a leak goes on with the pressure, and a transducer drifts independently of both.",
        (AW0, _single_stretch(RestPose(-15 * mm, rest=40 * s), RestPose(15 * mm, rest=40 * s))),
        (AW3, _single_stretch(RestPose(-15 * mm, rest=40 * s), RestPose(15 * mm, rest=40 * s))),
    ),
    _programme(
        "small_fast_sines",
        "Small sines of 5 to 12.5 Hz: inertia of the air or of masses, or a late sensor.",
        "The effect of inertia grows with the square of the frequency, that of a delay with the frequency.",
        (
            AW0,
            _single_stretch(
                Wave("vertical", 0.8 * mm, 5 * Hz, 20),
                Wave("vertical", 0.6 * mm, 6.25 * Hz, 25),
                Wave("vertical", 0.5 * mm, 8 * Hz, 32),
                Wave("vertical", 0.5 * mm, 10 * Hz, 40),
                Wave("vertical", 0.5 * mm, 12.5 * Hz, 50),
                Wave("lateral", 0.8 * mm, 5 * Hz, 20),
                Wave("lateral", 0.5 * mm, 10 * Hz, 40),
            ),
        ),
    ),
    _programme(
        "fast_lateral_sines",
        "Large lateral sines of 2 to 12.5 Hz: a lag of the force transducers or a latency.",
        "Both delay by τ; only a lag also reduces the amplitude, by ω²τ²/2, which is seen with large forces only.",
        (
            AW0,
            _single_stretch(
                Wave("lateral", 3 * mm, 2 * Hz, 20),
                Wave("lateral", 3 * mm, 5 * Hz, 50),
                Wave("lateral", 3 * mm, 8 * Hz, 80),
                Wave("lateral", 2 * mm, 12.5 * Hz, 250),
            ),
        ),
    ),
    _programme(
        "fast_vertical_sines",
        "Large vertical sines of 2 to 12.5 Hz: a lag of the pressure transducers or a latency.",
        "Both delay by τ; only a lag also reduces the amplitude, by ω²τ²/2, which is seen with large pressures only.",
        (
            AW3,
            _single_stretch(
                Wave("vertical", 3 * mm, 2 * Hz, 20),
                Wave("vertical", 3 * mm, 5 * Hz, 50),
                Wave("vertical", 2 * mm, 12.5 * Hz, 250),
            ),
        ),
    ),
    _programme(
        "large_sines",
        "Large sines of 1 and 2 Hz: the law of the orifice, and whether it is the same both ways.",
        "A flow that differs by direction separates the mean pressures, with the square of the amplitude.",
        (
            AW0,
            _single_stretch(
                Wave("vertical", 5 * mm, 1 * Hz, 8),
                Wave("vertical", 10 * mm, 1 * Hz, 8),
                Wave("vertical", 15 * mm, 1 * Hz, 8),
                Wave("vertical", 5 * mm, 2 * Hz, 12),
                Wave("vertical", 10 * mm, 2 * Hz, 12),
            ),
        ),
    ),
    _programme(
        "step_and_hold",
        "Steps of 10 mm, each held for two minutes: heat, and rubber that relaxes.",
        "The gas gives its heat off with one time constant and shows it in the pressure; rubber relaxes over decades "
        "of time, and only the force shows it.",
        (AW0, _single_stretch(RestPose(10 * mm, rest=2 * minutes), RestPose(-10 * mm, rest=2 * minutes))),
    ),
    _programme(
        "lateral_at_roll",
        "Lateral sweeps at fixed roll angles: coupling of lateral motion and roll, or crosstalk of load cells.",
        "Coupling needs roll and changes sign with it; crosstalk follows the load, without roll.",
        (
            AW3,
            tuple(
                stretch
                for roll in (20 * mrad, -20 * mrad, 40 * mrad)
                for stretch in _single_stretch(
                    Wave("lateral", 12 * mm, 0.25 * Hz, 3, "triangle"),
                    Wave("lateral", 6 * mm, 1 * Hz, 5),
                    start=RestPose(roll=roll),
                )
            ),
        ),
    ),
    _programme(
        "leveling_on",
        "Slow motion on the leveling valves: their dead band, their delay, or a leak.",
        "With the valves shut, their effect disappears and a leak remains.",
        (
            AW0,
            _single_stretch(
                Wave("vertical", 12 * mm, 0.05 * Hz, 4),
                Wave("roll", 10 * mrad, 0.1 * Hz, 3, "triangle"),
                valves=LEVELING,
            ),
        ),
    ),
    _programme(
        "differential_pressure",
        "Slow rolling with the differential pressure valve connected: sticking or leaking.",
        "A sound valve holds the pressure difference between 1.0 and 1.2 bar while the roll grows.",
        (
            AW3,
            _single_stretch(
                Wave("roll", 15 * mrad, 0.1 * Hz, 3, "triangle"),
                Wave("roll", 36 * mrad, 0.1 * Hz, 4, "triangle"),
                valves=DPV_CONNECTED,
            ),
        ),
    ),
    _programme(
        "bump_stop",
        "Large lateral sweeps: the bump stop, and softening by geometry.",
        "A stop gives a kink at its gap on both sides; geometry softens gradually and loses no energy.",
        (
            AW0,
            _single_stretch(
                Wave("lateral", 24 * mm, 0.1 * Hz, 3, "triangle"),
                Wave("lateral", 42 * mm, 0.1 * Hz, 3, "triangle"),
            ),
        ),
    ),
    _programme(
        "dither_at_offsets",
        "Lateral sines of 1 mm about offsets: softening by geometry or by friction.",
        "Geometry makes a small motion softer at a larger offset; friction does not depend on the offset.",
        (
            AW0,
            _single_stretch(
                *(
                    segment
                    for shear in (15 * mm, 30 * mm, 45 * mm, -30 * mm)
                    for segment in (RestPose(shear=shear), Wave("lateral", 1 * mm, 1 * Hz, 5))
                )
            ),
        ),
    ),
    _programme(
        "locked_hold",
        "Ten minutes without motion under the full car: slow leaks and drifting transducers.",
        "The mass of the air, m = pV/(RT), falls only where air is lost.",
        (AW3, _single_stretch(RestPose(rest=10 * minutes))),
    ),
    _programme(
        "isolated_reservoirs",
        "Sines with the auxiliary chambers shut off: bellows alone, without any orifice.",
        "Errors in volume, area or compliance of the bellows remain; errors of the orifice disappear.",
        (
            AW0,
            _single_stretch(
                Wave("vertical", 5 * mm, 0.1 * Hz, 3, "triangle"),
                Wave("vertical", 6 * mm, 0.5 * Hz, 4),
                Wave("vertical", 4 * mm, 1.25 * Hz, 7),
                Wave("vertical", 1.5 * mm, 5 * Hz, 20),
                valves=ISOLATED,
            ),
        ),
    ),
)

#: By name of the plan.
MENU: Final = {programme.name: programme for programme in _PROGRAMMES}

PLANS: Final = tuple(programme_plan(programme) for programme in _PROGRAMMES)
