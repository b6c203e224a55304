"""The bench's experiments repeated in the plant's model: the same pressures, amplitudes, offsets and frequencies."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from astb_studies.paper.subject import Subject
from astb_studies.paper.sweeps.frequency import PIPE_PLATE
from bench_protocol.arrays import Floats
from bench_protocol.units import Hz, m, ms, s
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.experiments import (
    LATERAL,
    ROLL,
    ImposedMotion,
    Shape,
    dynamic_stiffness,
    first_harmonic,
    impose,
)
from bench_sim.model.layout import Input
from bench_sim.model.plant import Plant

Complexes = npt.NDArray[np.complex128]

#: Fitted on the bench where a curve says "pipe".
PIPE: Final = {"pipe_length": 1.5 * m, "orifice_diameter": PIPE_PLATE}

_STEP: Final = 2.5 * ms


def lateral(subject: Subject, pressure: Floats, amplitude: Floats, f: float = 0.5 * Hz) -> Complexes:
    """Complex lateral stiffness in N/m of one spring at gauge pressures (Pa) and amplitudes (m), arrays of one shape.

    Each pressure carries its load at the design height of the spring.
    """
    area = float(subject.parameters("AW0").record.effective_area[0])
    found = [
        dynamic_stiffness(
            subject.resting("AW0", nominal_preload=p * area),
            a,
            f,
            4,
            direction=LATERAL,
            longest_step=4 * ms,
        )[0]
        for p, a in np.broadcast(pressure, amplitude)
    ]
    return np.array(found).reshape(np.broadcast(pressure, amplitude).shape)


def vertical(
    subject: Subject, load: str, amplitude: Floats, f: Floats, *without: str, cycles: int = 8, **changes: Any
) -> tuple[Complexes, Floats]:
    """Complex vertical stiffness in N/m, and the lowest pressure ratio of a cycle, over amplitude (m) and f (Hz).

    After at least half a second, as on the bench.
    """
    K, ratio = [], []
    for a, one in np.broadcast(amplitude, f):
        plant = subject.resting(load, *without, **changes)
        step = min(2 * ms, 1.0 / (32.0 * float(one)))
        value, last = dynamic_stiffness(
            plant, float(a), float(one), max(cycles if one > 0.3 else 2, int(0.5 * one)), longest_step=step
        )
        p_b, p_a = last.of(Algebraic.PRESSURE), last.of(Algebraic.AUXILIARY_PRESSURE)
        K.append(value)
        ratio.append(float(np.min(np.minimum(p_a / p_b, p_b / p_a))))
    return np.array(K), np.array(ratio)


def residual_loss(
    subject: Subject, load: str, amplitude: float, f: Floats, *without: str, **changes: Any
) -> tuple[Complexes, Complexes]:
    """K of the whole vertical force and of F_z − p_g A_0 alone, in N/m, over f (Hz): the second has no gas in it."""
    area = float(subject.parameters(load).record.effective_area[0])
    whole, rest = [], []
    for one in f:
        plant = subject.resting(load, *without, **changes)
        atmosphere = plant.parameters.atmospheric_pressure
        K, last = dynamic_stiffness(plant, amplitude, float(one), 12, longest_step=2 * ms)
        moved = first_harmonic(last.of(Algebraic.HEIGHT))
        gas = first_harmonic((last.of(Algebraic.PRESSURE) - atmosphere) * area)
        whole.append(K)
        rest.append(K + gas / moved)
    return np.array(whole), np.array(rest)


def lateral_over_frequency(
    subject: Subject, load: str, amplitude: Floats, f: Floats, **changes: Any
) -> Complexes:
    """Complex lateral stiffness in N/m of one spring over f (Hz) at amplitudes (m)."""
    return np.array(
        [
            dynamic_stiffness(
                subject.resting(load, **changes),
                float(a),
                float(one),
                max(4 if one > 0.3 else 2, int(0.5 * one)),
                direction=LATERAL,
                longest_step=2 * ms,
            )[0]
            for a, one in np.broadcast(amplitude, f)
        ]
    )


def tangent(
    subject: Subject, load: str, offset: Floats, amplitude: float, f: float, **changes: Any
) -> Complexes:
    """Complex lateral stiffness in N/m of a small motion (m, Hz) about offsets (m), once friction has settled."""
    found = []
    for y in offset:
        plant = subject.resting(load, **changes)
        impose(plant, [ImposedMotion(LATERAL, float(y), 1.0, Shape.RAMP)], 2 * s, dt=_STEP, rows=0)
        K, _ = dynamic_stiffness(
            plant, amplitude, f, 30, direction=LATERAL, longest_step=_STEP, offsets=(float(y), 0.0, 0.0)
        )
        found.append(K)
    return np.array(found)


def secant(subject: Subject, load: str, offset: Floats, **changes: Any) -> Floats:
    """F_y/y in N/m of springs without friction, six seconds after a ramp to the offsets (m), all chambers joined."""
    found = []
    for y in offset:
        plant = subject.resting(load, "friction", **changes)
        found.append(_static_force(plant, 0.0, float(y)) / float(y))
    return np.array(found)


def secant_of_stairs(
    subject: Subject, load: str, stairs: Sequence[float], **changes: Any
) -> tuple[Floats, Floats]:
    """|y| in m and (F(y) − F(−y))/(2y) in N/m, climbing ``stairs`` (m) with the bellows shut off.

    Each |y| is evaluated where it is reached first, including friction.
    """
    plant = subject.resting(load, **changes)
    plant.inputs[[Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = 0.0
    force: dict[float, float] = {}
    before = 0.0
    for y in stairs:
        found = _static_force(plant, before, y)
        force.setdefault(y, found)
        before = y
    sizes = sorted({abs(y) for y in stairs} - {0.0})
    return np.array(sizes), np.array([(force[y] - force[-y]) / (2.0 * y) for y in sizes])


def _static_force(plant: Plant, before: float, y: float) -> float:
    """Return the spring's lateral force in N, five seconds after a motion from ``before`` to ``y`` (m) within one."""
    impose(plant, [ImposedMotion(LATERAL, y - before, 1.0, Shape.RAMP, before)], 6 * s, dt=_STEP, rows=0)
    last = impose(plant, [ImposedMotion(LATERAL, 0.0, 1.0, offset=y)], _STEP, dt=_STEP)
    return float(-last.of(Algebraic.LATERAL_FORCE)[0])


def rolled(
    subject: Subject, load: str, roll: Floats, shear: float, amplitude: float, f: float
) -> tuple[Floats, Complexes]:
    """Secant F_y/y and first harmonic, in N/m, of a sine (m, Hz) about ``shear`` m at fixed roll angles (rad).

    Mean of both springs; the differential pressure valve is isolated.
    """
    secants, harmonics = [], []
    cycles = 10
    for angle in roll:
        plant = subject.resting(load)
        middle = shear - plant.parameters.centre_height * float(angle)
        ramps = [
            ImposedMotion(ROLL, float(angle), 0.5, Shape.RAMP),
            ImposedMotion(LATERAL, middle, 0.5, Shape.RAMP),
        ]
        impose(plant, ramps, 3 * s, dt=_STEP, rows=0)
        sway = [
            ImposedMotion(ROLL, 0.0, 1.0, offset=float(angle)),
            ImposedMotion(LATERAL, amplitude, f, offset=middle),
        ]
        course = impose(plant, sway, cycles / f, dt=_STEP)
        last = slice(-round(1.0 / (f * _STEP)), None)
        F = -0.5 * (course.of(Algebraic.LATERAL_FORCE, 0) + course.of(Algebraic.LATERAL_FORCE, 1))[last]
        y = course.of(Algebraic.LATERAL)[last]
        secants.append(float(F.mean() / y.mean()))
        harmonics.append(first_harmonic(F) / first_harmonic(y))
    return np.array(secants), np.array(harmonics)


#: What makes a measured damping larger than that of the orifice alone, or seems to.
LAG: Final = 5 * ms
NARROWER: Final = 0.95


def lookalikes(subject: Subject, load: str, amplitude: Floats, f: Floats) -> dict[str, Complexes]:
    """Complex vertical stiffness in N/m of the orifice alone and of the three things that add 5 % to its damping.

    ``orifice``: no rubber; ``rubber``: shell and friction as in the plant; ``lag``: no rubber, but the force read 5 ms
    after it acts less than the displacement does; ``coefficient``: no rubber, the orifice's C_d 5 % smaller than
    assumed. Over amplitude (m) and f (Hz), broadcast.
    """
    C_d = subject.parameters(load).record.discharge_coefficient[0]
    orifice, _ = vertical(subject, load, amplitude, f, "rubber", cycles=12)
    rubber, _ = vertical(subject, load, amplitude, f, cycles=12)
    narrow, _ = vertical(
        subject, load, amplitude, f, "rubber", cycles=12, discharge_coefficient=NARROWER * float(C_d)
    )
    late = 1.0 + 2j * np.pi * np.broadcast_to(f, orifice.shape) * LAG
    return {"orifice": orifice, "rubber": rubber, "lag": orifice * late, "coefficient": narrow}


def residuals(subject: Subject, load: str, amplitude: float, f: Floats) -> dict[str, Complexes]:
    """Return the three causes of `lookalikes` in the force without pressure times area, in N/m over f (Hz)."""
    C_d = subject.parameters(load).record.discharge_coefficient[0]
    rubber = residual_loss(subject, load, amplitude, f)[1]
    orifice, rest = residual_loss(subject, load, amplitude, f, "rubber")
    narrow = residual_loss(
        subject, load, amplitude, f, "rubber", discharge_coefficient=NARROWER * float(C_d)
    )[1]
    late = 2j * np.pi * f * LAG
    return {"orifice": rest, "rubber": rubber, "lag": rest + orifice * late, "coefficient": narrow}
