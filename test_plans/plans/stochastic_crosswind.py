"""Stochastic crosswind: a random wind with von Kármán's spectrum from a seed, while the platform runs a track."""

from cmath import phase
from collections.abc import Callable, Mapping
from functools import partial
from typing import Annotated, Final, Literal

import numpy as np
import numpy.typing as npt

from bench_protocol.units import FACTORS, Hz, s
from test_plans import steps
from test_plans.analysis import (
    HEIGHTS,
    PRESSURES,
    SHEAR_CELLS,
    VERTICAL_CELLS,
    Samples,
)
from test_plans.analysis.cells import CELLS, CELLS_ACROSS, sideways_force, upward_force
from test_plans.analysis.geometry import POSE_SIGNALS, SEEING, Rig, shear_of
from test_plans.analysis.spectra import SIGMAS_OF_95, Spectra, spectra
from test_plans.check_names import CheckName
from test_plans.description import lag_of, lags
from test_plans.parameters import Range
from test_plans.plan import plan
from test_plans.preconditions import on_the_bench
from test_plans.run import Run
from test_plans.steps.carrying import FREE_SIDEWAYS
from test_plans.steps.fittings import leave_connected
from test_plans.steps.poses import COOL, go_home
from test_plans.steps.shaking import check_band
from test_plans.steps.tables import FREQUENCY, MAGNITUDE, keep
from test_plans.steps.wind import RISE, admittance, fade, random_process, side_force, spectrum

#: Amplitude and rate of the motion by the track depend on the speed: the limits hold for this one.
TRAIN_SPEED: Final = 100 * FACTORS["km/h"]
TRACK: Final = ("platform.vertical", "platform.lateral")
READ: Final = (*POSE_SIGNALS, *TRACK, *SHEAR_CELLS, *VERTICAL_CELLS, *PRESSURES)
Values = Mapping[str, Samples]
STEP: Final = 0.02 * s
#: Sampling rate: ten times the highest frequency of wind and track.
RATE: Final = 50 * Hz
BEFORE: Final = 2 * s
#: Highest frequency that the host can stream; and the lowest one, because slower motions belong to the line of the
#: track and not to its irregularity.
FASTEST: Final = 5 * Hz
SLOWEST: Final = 0.2 * Hz
SEGMENT: Final = 8 * s
#: Frequencies at which wind and track move the springs enough to measure their stiffness.
BAND: Final = (0.5 * Hz, 2 * Hz)
#: The checks of the motion of springs and pressures: name, limit and unit.
SWINGS: Final = (
    (
        CheckName(
            "lateral displacement, rms about its mean",
            "How much the springs sway in gusts and on the track: it affects comfort and clearance all the time.",
        ),
        "displacement_rms",
        "mm",
    ),
    (
        CheckName(
            "lateral displacement, exceeded in 1 % of the time",
            "The displacement that is exceeded in 1 % of the time: the car needs this much lateral clearance.",
        ),
        "displacement",
        "mm",
    ),
    (
        CheckName(
            "pressure, largest rms of a chamber",
            "How much the pressure varies: it loads the bellows and the valve between the springs, and wears both.",
        ),
        "pressure_rms",
        "mbar",
    ),
)
OVER: Final = f"{BAND[0]:g} to {BAND[1]:g} Hz"
STIFF: Final = {
    "lateral": CheckName(
        f"lateral stiffness K', {OVER}",
        "Lateral stiffness in a motion as on the track, not in a sine: friction acts there as it does in service.",
    ),
    "vertical": CheckName(
        f"vertical stiffness K', {OVER}",
        "Vertical stiffness in a motion as on the track: it determines the "
        "natural frequency of the car on its springs.",
    ),
}
LOST: Final = CheckName(
    f"vertical loss angle, {OVER}",
    "How much energy the orifice turns into heat: with too little the car bounces, with too much it transmits jolts.",
)
INCOHERENT: Final = "what is not coherent"
LINES: Final = tuple(0.25 * Hz * k for k in range(1, 13))
#: Corner wavenumbers of the irregularity (1/m), and its low level (rad·m), vertical and lateral (ERRI B 176).
CORNERS: Final = (0.0206, 0.8246)
LEVEL: Final = (4.032e-7, 2.119e-7)


def take_up(run: Run, load: str) -> None:
    """Load the springs, hold them at design height, shut them, and release the bolster sideways."""
    steps.carry_load(run, load)
    go_home(run)
    run.bench.wait(COOL)
    steps.lock_the_air(run)
    run.bench.lateral.push(0.0)


@plan(
    setup=take_up,
    needs=(
        *steps.CARRYING,
        *READ,
        *FREE_SIDEWAYS,
        *(f"{axis}_setpoint" for axis in TRACK),
        *SEEING,
        *CELLS,
        *CELLS_ACROSS,
        *lags(("lateral.displacement", *HEIGHTS, *SHEAR_CELLS, *VERTICAL_CELLS)),
    ),
    teardown=leave_connected,
    lasts=121 * s,
    requires=on_the_bench("load"),
    checks=(*(name for name, *_ in SWINGS), *STIFF.values(), LOST),
)
def stochastic_crosswind(
    run: Run,
    *,
    load: Literal["AW0", "AW3"] = "AW0",
    wind: Annotated[float, Range(3.0, 6.5, "m/s")] = 6.0,
    duration: Annotated[float, Range(40 * s, 1000 * s, "s")] = 60 * s,
    draw: Annotated[int, Range(0, 1_000_000)] = 1,
) -> None:
    """Stochastic crosswind: the springs in a gusty wind while the platform runs a track.

    The springs carry the load with shut valves at design height. The lateral actuator applies the force of a `wind` on
    one bogie at 100 km/h. The wind has von Kármán's spectrum and a turbulence of 15 % of the mean. The platform
    follows the irregularity of the track, vertically and laterally, with the spectrum of ERRI B 176 between 0.2 and 5
    Hz. The vertical actuators hold the bolster in its place, as the inertia of a car does. The same number `draw` gives
    the same wind and track.

    The specimen's file has the limits for these results:

    * the lateral displacement: its rms about its mean, and the value that is exceeded in 1 % of the time;
    * the rms of the pressures;
    * the stiffness in both directions, from cross spectra between 0.5 and 2 Hz; its uncertainty comes from the
      coherence;
    * the vertical loss angle, which comes from the orifice.
    """
    limits = run.specimen.load(load).limits
    steps_in_all = round((duration + 2 * RISE) / STEP)
    times = np.linspace(0.0, steps_in_all * STEP, steps_in_all + 1)
    moves = excitation(times, wind, draw)
    with run.phase("wind and track"):
        with run.bench.capture(*READ) as capture:
            run.bench.wait(BEFORE)
            run.bench.waveform.run(times, moves)
        at, values = capture.aligned(RATE)
    steady = (at >= BEFORE + RISE) & (at < BEFORE + RISE + duration)
    found = run.measure(partial(_swings, at < BEFORE, steady), run.rig, values, rate=RATE)
    for (name, limit, unit), value in zip(SWINGS, found, strict=True):
        check_band(run, name, value, unit, limits.band(f"stochastic_crosswind.{limit}", unit))
    check_stiffness(run, load, "lateral", values, partial(_sideways, steady))
    check_stiffness(run, load, "vertical", values, partial(upright, steady))


def _swings(
    calm: npt.NDArray[np.bool_], steady: npt.NDArray[np.bool_], rig: Rig, values: Values
) -> tuple[float, float, float]:
    """Return the rms of the displacement about its mean (m), the 99th percentile of its magnitude (m), and the rms of
    the pressure that varies most (Pa).
    """
    y = shear_of(values, rig) - values["platform.lateral"]
    y = (y - y[calm].mean())[steady]
    swing = float(np.max([values[name][steady].std() for name in PRESSURES]))  # NaN if one is
    return float(y.std()), float(np.percentile(np.abs(y), 99.0)), swing


def _sideways(steady: npt.NDArray[np.bool_], rig: Rig, values: Values) -> Spectra:
    """Return the spectra of the shear of the springs (x) and of the lateral force that opposes it (y)."""
    y = shear_of(values, rig) - values["platform.lateral"]
    force = -sideways_force(values, rig)
    late = lag_of(rig, "lateral.displacement"), lag_of(rig, *SHEAR_CELLS)
    return spectra(y[steady], force[steady], RATE, segment=SEGMENT, x_lag=late[0], y_lag=late[1])


def upright(steady: npt.NDArray[np.bool_], rig: Rig, values: Values) -> Spectra:
    """Return the spectra of the mean compression of both springs (x) and of their mean load (y), from the samples where
    ``steady`` is True.
    """
    down = -0.5 * (values["left.height"] + values["right.height"])
    force = 0.5 * upward_force(values, rig)
    late = lag_of(rig, *HEIGHTS), lag_of(rig, *VERTICAL_CELLS)
    return spectra(down[steady], force[steady], RATE, segment=SEGMENT, x_lag=late[0], y_lag=late[1])


def excitation(times: Samples, wind: float, draw: int) -> dict[str, Samples]:
    """Return the set-points due to wind and track at equally spaced ``times`` (s), by reading: force of the lateral
    actuator (N), motion of the platform (m).
    """
    generator = np.random.default_rng(draw)
    f = np.fft.rfftfreq(times.size, times[1])
    passing = (f >= SLOWEST) & (f <= FASTEST)
    gusts = spectrum(f, wind, TRAIN_SPEED) * admittance(f, wind, TRAIN_SPEED) * (f <= FASTEST)
    moves = {
        "lateral.force": side_force(wind + random_process(times, gusts, generator), TRAIN_SPEED),
    }
    for axis, level in zip(TRACK, LEVEL, strict=True):
        moves[axis] = random_process(times, irregularity(f, level, TRAIN_SPEED) * passing, generator)
    return {name: fade(times) * way for name, way in moves.items()}


def irregularity(f: Samples, level: float, train_speed: float) -> Samples:
    """Return the one-sided spectrum of the track (m² per Hz) under a train of ``train_speed`` (m/s).

    S(Ω) = A Ω_c² / ((Ω² + Ω_r²)(Ω² + Ω_c²)) with Ω = 2πf/V, times 2π/V.
    """
    low, high = CORNERS
    omega2 = np.square(2 * np.pi * f / train_speed)
    return np.asarray(level * high**2 / ((omega2 + low**2) * (omega2 + high**2)) * 2 * np.pi / train_speed)


def check_stiffness(
    run: Run, load: str, direction: str, values: Values, of: Callable[[Rig, Values], Spectra]
) -> None:
    """Check K' in the frequency band, and vertically also the loss angle. Record the stiffness over frequency.

    The limits are valid for a track of the low level under a train of ``TRAIN_SPEED``.
    """
    limits = run.specimen.load(load).limits
    found = of(run.rig, values)
    K = found.between(*BAND)

    def numbers(rig: Rig, read: Values) -> tuple[float, float]:
        moved = of(rig, read).between(*BAND).value
        return moved.real, phase(moved)

    # Uncertainty by the instruments and by the incoherent part.
    stiffness, angle = run.measure(numbers, run.rig, values, rate=RATE)
    band = limits.band(f"stochastic_crosswind.{direction}_stiffness", "kN/m")
    note = f"coherence {K.coherence:.4f}, {K.averages:.0f} averages"
    one = stiffness.with_uncertainty(INCOHERENT, K.uncertainty)
    run.check(STIFF[direction], one, "kN/m", low=band.low, high=band.high, note=note)
    if direction == "vertical":
        lost = limits.band("stochastic_crosswind.vertical_loss_angle", "deg")
        check_band(
            run,
            LOST,
            angle.with_uncertainty(INCOHERENT, K.uncertainty / abs(K.value)),
            "deg",
            lost,
        )
    keep_stiffness(run, load, direction, found)


def keep_stiffness(run: Run, load: str, direction: str, found: Spectra) -> None:
    """Record |K| over frequency with its uncertainty."""
    lines = [found.between(f - 0.125 * Hz, f + 0.125 * Hz) for f in LINES]
    sizes = [(abs(one.value), SIGMAS_OF_95 * one.uncertainty) for one in lines]
    for name, ys in (
        (load, [size for size, _ in sizes]),
        (f"{load}, 97.5 %", [size + more for size, more in sizes]),
        (f"{load}, 2.5 %", [size - more for size, more in sizes]),
    ):
        group = f"{direction.capitalize()} {MAGNITUDE[0]} from spectra"
        keep(run, name, group, FREQUENCY, MAGNITUDE, list(LINES), ys)
