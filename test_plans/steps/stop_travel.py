"""Prediction of the bolster's travel toward its bump stop under wind, track and roll, from the specimen's limits.

A plan compares this travel with the gap of the stop before any motion.
"""

from collections.abc import Mapping
from math import inf, pi, tau
from typing import Final

import numpy as np

from bench_protocol.units import Hz, mm
from test_plans.analysis import Samples
from test_plans.loads import Band, Load
from test_plans.steps.wind import CAR

Rig = Mapping[str, float]

#: The file states the lateral damping over the amplitude at this frequency.
SLOW: Final = 0.5 * Hz
#: Number of iterations: stiffness and amplitude of the track's motion depend on each other.
TURNS: Final = 12
#: Beyond the limits of the file the stiffness is constant, up to this travel (m).
FARTHEST: Final = 1000 * mm
GUST: Final = "crosswind_gust.stiffness"
ROLL_STIFFNESS: Final = "crosswind_and_track.roll_stiffness"


def blown(load: Load, rig: Rig, force: Samples, pressure: float) -> Samples:
    """Return the lateral travel (m) of the bolster under a wind ``force`` (N), on the softest springs within their
    limits.

    The track keeps the springs in motion, so friction does not act as a static force. ``pressure`` is the ratio to the
    pressure of the load.
    """
    stiffness = load.limits.band(ROLL_STIFFNESS, "kN*m/rad").low or inf
    return np.asarray(
        _sheared(load, force, pressure, _friction(load))
        + rig["centre_height"] * force * CAR.pressure_height / stiffness
    )


def leaned(load: Load, rig: Rig, roll: float, pressure: float) -> tuple[float, float]:
    """Return the lateral travel (m) of the bolster at a ``roll`` (rad) by unequal preload: with friction, and without
    friction.

    The travel results from the coupling of shear and roll.
    """
    curve = load.limits.curve("roll_coupling.force", "kN")
    force = 2 * np.interp(roll, *_odd([*curve], [_middle(band) for band in curve.values()]))
    held, free = (float(_sheared(load, force, pressure, friction)) for friction in (0.0, _friction(load)))
    return -held - rig["centre_height"] * roll, -free - rig["centre_height"] * roll


def shaken(load: Load, rig: Rig, times: Samples, platform: Samples, pressure: float) -> Samples:
    """Return the travel (m, (n,)) of the bolster relative to the platform, which moves by ``platform`` (m, (n,)).

    The model is a mass on a complex stiffness that depends on the amplitude, solved by spectra. The platform begins and
    ends at 0.
    """
    count = 2 * times.size
    omega = tau * np.fft.rfftfreq(count, times[1] - times[0])
    inertia = rig["bolster_mass"] * omega**2
    moved = np.fft.rfft(platform, count)
    small = load.limits.curve("crosswind_and_track.stiffness", "kN/m")
    large = load.limits.curve(GUST, "kN/m")
    soft = {
        place: band.low or 0.0
        for place, band in {**large, **small}.items()
        if place in small or place > max(small)
    }
    soft = dict(sorted(soft.items()))
    loss = load.limits.curve("crosswind_and_track.loss", "kN/m")
    amplitude, way = 1 * mm, np.zeros_like(times)
    for _ in range(TURNS):
        storage = np.interp(amplitude, list(soft), list(soft.values())) + _stiffer(load, pressure)
        lost = np.interp(amplitude, list(loss), [_middle(band) for band in loss.values()])
        way = np.fft.irfft(inertia * moved / (storage + 1j * lost - inertia), count)[: times.size]
        amplitude = 0.5 * (amplitude + 0.5 * float(np.ptp(way)))
    return np.asarray(way)


def _sheared(load: Load, force: Samples | float, pressure: float, friction: float) -> Samples:
    """Return the shear (m) of the softest pair of springs under a ``force`` (N). ``friction`` (N) is subtracted from
    its force curve.
    """
    more = _stiffer(load, pressure)
    soft = {
        way: ((band.low or 0.0) + more) * way - friction
        for way, band in load.limits.curve(GUST, "kN/m").items()
    }
    last = max(soft)
    soft[FARTHEST] = soft[last] * FARTHEST / last
    return np.asarray(np.interp(force, *_odd([*soft.values()], [*soft])))


def _odd(x: list[float], y: list[float]) -> tuple[list[float], list[float]]:
    """Extend a rising curve from positive to negative values as an odd function, and return its points."""
    return [*(-one for one in reversed(x)), 0.0, *x], [*(-one for one in reversed(y)), 0.0, *y]


def _friction(load: Load) -> float:
    """Return the friction of the pair (N), computed from its damping.

    A friction loop has the area 4 F a, a damping loop the area π ω c a².
    """
    damping = load.limits.curve("lateral_damping_by_amplitude")
    widest = max(damping)
    return 2 * 0.25 * pi * tau * SLOW * _middle(damping[widest]) * widest


def _stiffer(load: Load, pressure: float) -> float:
    """Return by how much (N/m) the pair is stiffer at ``pressure``, the ratio to the pressure of the load."""
    by_pressure = _middle(load.limits.band("lateral_stiffness_by_pressure"))
    return 2 * by_pressure * (pressure - 1.0) * load.fill_pressure


def _middle(band: Band) -> float:
    return 0.5 * ((band.low or 0.0) + (band.high or 0.0))
