"""Identification: the parameters of the spring from what the bench recorded, with confidence intervals.

The plant's law of an inextensible bellows, at its own displacement (ζ_b, y_b) behind the emergency spring:

    V = V_0 + A_0 ζ_b + ½ A_1 ζ_b² − ½ (κ_0 + κ_1 ζ_b) Y,  A_e = A_0 + A_1 ζ_b − ½ κ_1 Y,  Y = y_b²/(1 + (y_b/y_s)²)

and the paper's ``A = A_L0 (1 − α y²)``, ``V = V_0 (1 + β y²)``. Everything comes from the curves of a ``result.json``;
what is not fitted is read from the base parameter file that the result will replace.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import pi, tau
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.units import ATMOSPHERE, FACTORS, N, mbar, mm
from test_plans.by_pressure import AMPLITUDES, SLOW
from test_plans.loads import AW0, AW3, Load
from test_plans.tables import DAMPING, STORAGE

if TYPE_CHECKING:
    from bench_records.result import Curve

Floats = npt.NDArray[np.float64]

#: What a mean over 2 s is good for: the wire's step of 25 N a cell, friction that creeps by a tenth of its 300 N; and
#: for T/p thermometers in steps of 0.05 K, two of them.
FORCE_SCATTER: Final = 25 * N
GAS_SCATTER: Final = 1e-4
#: Zeros by the data sheets, evenly spread within: 25 mbar on each of two transducers, 200 N on each of four cells (half
#: of them a spring), and in each load the vertical friction that was left.
PRESSURE_ZERO: Final = 25 * mbar / 6**0.5
FORCE_ZERO: Final = 200 * N / 3**0.5
FRICTION_LEFT: Final = 60 * N
#: First harmonics: what comes back from run to run.
HARMONIC_SCATTER: Final = 0.3e3  # N/m


class NotIdentified(ValueError):
    """Curves or a parameter file that do not hold what the identification needs."""


# -- fits ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Fit:
    """Fitted values (SI) with their covariance; named as in the parameter files where they stand there."""

    names: tuple[str, ...]
    values: Floats
    covariance: Floats  #: shape (n, n)
    misfit: float  #: rms of the residuals over their expected scatter
    freedom: int  #: residuals less parameters

    def __getitem__(self, name: str) -> float:
        return float(self.values[self._place(name)])

    def sigma(self, name: str) -> float:
        """Return the standard deviation of a value."""
        place = self._place(name)
        return float(np.sqrt(self.covariance[place, place]))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of a value (Student's t)."""
        from scipy.stats import t

        reach = float(t.ppf(0.5 * (1 + level), max(self.freedom, 1))) * self.sigma(name)
        return self[name] - reach, self[name] + reach

    def _place(self, name: str) -> int:
        if name not in self.names:
            raise NotIdentified(f"{name} was not fitted; there is {', '.join(self.names)}")
        return self.names.index(name)


def fit(residuals: Callable[[Mapping[str, float]], Floats], start: Mapping[str, float]) -> Fit:
    """Minimise the sum of squares of ``residuals`` (each over its expected scatter) from ``start`` on.

    The covariance is (JᵀJ)⁻¹ at the minimum, times the square of the misfit where that exceeds 1: what was expected too
    small counts as it came. NotIdentified if there are too few residuals or the minimum is not found.
    """
    from scipy.optimize import least_squares

    names = tuple(start)
    scale = np.array([abs(value) or 1.0 for value in start.values()])

    def scaled(x: Floats) -> Floats:
        return residuals(dict(zip(names, (x * scale).tolist(), strict=True)))

    solution = least_squares(
        scaled, np.array(list(start.values())) / scale, x_scale="jac", xtol=1e-12, ftol=1e-12
    )
    freedom = solution.fun.size - len(names)
    if not solution.success or freedom < 0:
        raise NotIdentified(f"{', '.join(names)} from {solution.fun.size} residuals: {solution.message}")
    misfit = float(np.sqrt(np.sum(solution.fun**2) / max(freedom, 1)))
    try:
        covariance = np.linalg.inv(solution.jac.T @ solution.jac) * max(misfit, 1.0) ** 2
    except np.linalg.LinAlgError:
        raise NotIdentified(f"the curves do not tell {', '.join(names)} apart") from None
    return Fit(names, solution.x * scale, covariance * np.outer(scale, scale), misfit, freedom)


# -- what the bench recorded ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Isolated:
    """What was read of one spring shut off from its auxiliary chamber, step by step (SI), under one load."""

    preload: float
    height: Floats
    shear: Floats
    pressure: Floats  #: gauge
    temperature: Floats
    vertical: Floats
    lateral: Floats
    sheared: npt.NDArray[np.bool_]  #: steps to the side; the others are steps of height


def isolated(curves: Iterable[Curve], load: Load) -> Isolated:
    """Return the steps of plan ``lateral_offset`` under ``load``; NotIdentified if the curves do not hold them."""
    kept = list(curves)

    def both(quantity: str) -> Floats:
        parts = [
            _ys(kept, f"Isolated bellows {what}: {quantity}", load.name) for what in ("sheared", "lifted")
        ]
        return np.concatenate(parts)

    sheared = _ys(kept, "Isolated bellows sheared: height", load.name).size
    height = both("height")
    return Isolated(
        load.preload,
        height,
        both("lateral displacement"),
        both("pressure"),
        both("temperature"),
        both("vertical force"),
        both("lateral force"),
        np.arange(height.size) < sheared,
    )


@dataclass(frozen=True, slots=True)
class Sheared:
    """First harmonics of the lateral stiffness per spring: pressure (Pa gauge), amplitude (m), K (N/m), complex."""

    pressure: Floats
    amplitude: Floats
    stiffness: npt.NDArray[np.complex128]


def sheared(curves: Iterable[Curve], load: Load) -> Sheared:
    """Return what a plan ``lateral_pressure`` around ``load`` found; NotIdentified if the curves do not hold it."""
    kept = list(curves)
    pressure, amplitude, stiffness = [], [], []
    for size in AMPLITUDES:
        name = f"{size / mm:g} mm"
        group = f"Lateral {STORAGE[0]} per spring, {load.name}"
        storage = _ys(kept, group, name)
        damping = _ys(kept, f"Lateral {DAMPING[0]} per spring, {load.name}", name)
        pressure.append(_xs(kept, group, name))
        amplitude.append(_ys(kept, f"Lateral amplitude per spring, {load.name}", name))
        stiffness.append(storage + 1j * tau * SLOW * damping)
    return Sheared(np.concatenate(pressure), np.concatenate(amplitude), np.concatenate(stiffness))


def _curve(curves: Sequence[Curve], group: str, name: str) -> Curve:
    for one in curves:
        if (one.group, one.name) == (group, name):
            return one
    raise NotIdentified(f"there is no curve {name!r} of {group!r}: it comes from another plan")


def _xs(curves: Sequence[Curve], group: str, name: str) -> Floats:
    return np.array(_curve(curves, group, name).xs, np.float64)


def _ys(curves: Sequence[Curve], group: str, name: str) -> Floats:
    return np.array(_curve(curves, group, name).ys, np.float64)


# -- what is known -------------------------------------------------------------------------------------------------

#: Units of parameter files that a wire does not know.
_UNITS: Final = FACTORS | {"m2": 1.0, "N/Pa": 1.0, "MN/m": 1e6, "N*s/m": 1.0}


class Known:
    """The parameters of a file (SI), by name; one number for both springs."""

    def __init__(self, base: str) -> None:
        self._entries: dict[str, Any] = {}
        for section in tomllib.loads(base).values():
            self._entries |= {name: one for name, one in section.items() if isinstance(one, dict)}

    def all(self, name: str) -> Floats:
        """Return every number of a parameter; NotIdentified if the file lacks it or its unit is strange."""
        entry = self._entries.get(name)
        if entry is None:
            raise NotIdentified(f"the base parameter file has no {name}")
        if entry["unit"] not in _UNITS:
            raise NotIdentified(f"{name} is in {entry['unit']}; {', '.join(_UNITS)} are known")
        return np.atleast_1d(np.array(entry["value"], np.float64)) * _UNITS[entry["unit"]]

    def __getitem__(self, name: str) -> float:
        return float(self.all(name).mean())


# -- effective area and volume (figure 7) --------------------------------------------------------------------------


def shape(y: Floats, travel: float) -> Floats:
    """Y = y²/(1 + (y/y_s)²) in m²."""
    return np.asarray(y**2 / (1 + (y / travel) ** 2))


def own_displacements(one: Isolated, known: Known) -> tuple[Floats, Floats]:
    """Return (ζ_b, y_b): what the bellows itself is lifted and sheared, without its emergency spring."""
    height = one.height + (one.vertical - one.preload) / known["emergency_stiffness_vertical"]
    return height, one.shear - one.lateral / known["emergency_stiffness_lateral"]


def fit_area_and_volume(steps: Sequence[Isolated], known: Known) -> Fit:
    """Fit A_0, κ_1, V_0 and κ_0 to force, pressure and temperature of isolated bellows under several loads.

    ``F_z = p A_e − k_z ζ_b`` where the springs were sheared, and ``p V/T = const`` everywhere. Zeros of transducers and
    load cells are fitted within their data sheets, and the mass of gas under each load freely.
    """
    travel, slope = known["membrane_travel"], known["effective_area_slope"]
    shell = known["shell_stiffness_vertical"]
    places = [own_displacements(one, known) for one in steps]
    start = {
        "effective_area": known["effective_area"],
        "bellows_volume": known["bellows_volume"],
        "membrane_length": known["membrane_length"],
        "membrane_length_slope": known["membrane_length_slope"],
        "pressure_zero": 0.0,
        "force_zero": 0.0,
        "lateral_zero": 0.0,
    }
    scale = {"pressure_zero": PRESSURE_ZERO, "force_zero": FORCE_ZERO, "lateral_zero": 1 * mm}
    for k, one in enumerate(steps):
        amount = (one.pressure[0] + ATMOSPHERE) / one.temperature[0] * start["bellows_volume"]
        start[f"gas_{k}"], start[f"friction_{k}"] = 1.0, 0.0
        scale[f"gas_{k}"], scale[f"friction_{k}"] = float(amount), FRICTION_LEFT

    def residuals(x: Mapping[str, float]) -> Floats:
        value = {name: number * scale.get(name, 1.0) for name, number in x.items()}
        parts = [np.array([x["pressure_zero"], x["force_zero"]])]
        for k, (one, (height, y)) in enumerate(zip(steps, places, strict=True)):
            Y = shape(y - value["lateral_zero"], travel)
            gauge = one.pressure - value["pressure_zero"]
            length = value["membrane_length"] + value["membrane_length_slope"] * height
            area = value["effective_area"] + slope * height - 0.5 * value["membrane_length_slope"] * Y
            volume = value["bellows_volume"] + (value["effective_area"] + 0.5 * slope * height) * height
            volume = volume - 0.5 * length * Y
            force = gauge * area - shell * height + value["force_zero"] + value[f"friction_{k}"]
            gas = (gauge + ATMOSPHERE) * volume / (one.temperature * value[f"gas_{k}"])
            parts.append((one.vertical - force)[one.sheared] / FORCE_SCATTER)
            parts.append((gas - 1.0) / GAS_SCATTER)
            parts.append(np.array([x[f"friction_{k}"]]))
        return np.concatenate(parts)

    return _in_units(fit(residuals, start), scale)


def _in_units(found: Fit, scale: Mapping[str, float]) -> Fit:
    factors = np.array([scale.get(name, 1.0) for name in found.names])
    covariance = found.covariance * np.outer(factors, factors)
    return Fit(found.names, found.values * factors, covariance, found.misfit, found.freedom)


def fit_paper_law(y: Floats, area: Floats, volume: Floats) -> Fit:
    """Fit the paper's A = A_L0 (1 − α y²) and V/V(0) = 1 + β y² (1/m²) to curves over lateral displacement (m).

    The scatter is what the residuals show.
    """

    def law(values: Floats, name: str, sign: float) -> Fit:
        start = {f"{name}_centre": float(values.max()), name: 1.0}

        def residuals(x: Mapping[str, float]) -> Floats:
            return np.asarray(
                (values - x[f"{name}_centre"] * (1 + sign * x[name] * y**2)) / (1e-4 * values.max())
            )

        return fit(residuals, start)

    first, second = law(area, "alpha", -1.0), law(volume, "beta", 1.0)
    size = len(first.names)
    covariance = np.zeros((2 * size, 2 * size))
    covariance[:size, :size], covariance[size:, size:] = first.covariance, second.covariance
    values = np.concatenate([first.values, second.values])
    return Fit(
        first.names + second.names,
        values,
        covariance,
        max(first.misfit, second.misfit),
        min(first.freedom, second.freedom),
    )


# -- lateral stiffness against pressure (figure 6) -----------------------------------------------------------------

_PHASES: Final = (np.arange(256) + 0.5) / 256 * pi


def friction_stiffness(amplitude: Floats, limit: Floats, travel: float) -> npt.NDArray[np.complex128]:
    """Return the first harmonic (N/m) of Berg's friction in its settled loop of ``amplitude`` (m).

    The loop turns at ±F_0 with F_0 = F_max/(2 x_2) [√(x_2² + x_0² + 6 x_2 x_0) − x_2 − x_0].
    """
    a = np.asarray(amplitude)[..., None]
    F_max = np.asarray(limit)[..., None]
    level = (np.sqrt(travel**2 + a**2 + 6 * travel * a) - travel - a) / (2 * travel)
    s = a * (1 - np.cos(_PHASES))  # up from the lower turning point
    force = F_max * (-level + s / (travel * (1 + level) + s) * (1 + level))
    # x = −a cos θ, and the way down is the way up turned round.
    harmonic = 2 / pi * np.sum(force * np.exp(-1j * _PHASES), axis=-1) * (pi / _PHASES.size)
    return np.asarray(harmonic / -a[..., 0])


def lateral_stiffness(
    value: Mapping[str, float], pressure: Floats, amplitude: Floats, frequency: float, known: Known
) -> npt.NDArray[np.complex128]:
    """Return the first harmonic K (N/m) of membrane, shell and friction in series with the emergency spring."""
    stack, travel = known["emergency_stiffness_lateral"], known["membrane_travel"]
    maxwell = tau * frequency * known.all("maxwell_time")
    shell = value["shell_stiffness_lateral"] * (
        1 + np.sum(known.all("maxwell_ratio") * 1j * maxwell / (1 + 1j * maxwell))
    )
    limit = value["friction_lateral"] + value["friction_lateral_slope"] * pressure
    own = np.array(amplitude)
    K = np.zeros(own.shape, np.complex128)
    for _ in range(4):  # the bellows takes what the emergency spring leaves
        membrane = value["membrane_length"] * pressure * (1 - 1.5 * (own / travel) ** 2)
        K = membrane + shell + friction_stiffness(own, limit, value["friction_lateral_travel"])
        own = amplitude * np.abs(stack / (K + stack))
    return np.asarray(K * stack / (K + stack))


def fit_lateral_stiffness(found: Sequence[Sheared], known: Known) -> Fit:
    """Fit κ_0, shell stiffness and Berg's friction to first harmonics over pressure and amplitude, at design height.

    Membrane and friction both grow with pressure: only the amplitude tells them apart, so all amplitudes are fitted at
    once. How the shell creeps (its Maxwell branches) is known.
    """
    pressure = np.concatenate([one.pressure for one in found])
    amplitude = np.concatenate([one.amplitude for one in found])
    stiffness = np.concatenate([one.stiffness for one in found])
    names = (
        "membrane_length",
        "shell_stiffness_lateral",
        "friction_lateral",
        "friction_lateral_slope",
        "friction_lateral_travel",
    )
    start = {name: known[name] for name in names} | {"pressure_zero": 0.0}

    def residuals(x: Mapping[str, float]) -> Floats:
        gauge = pressure - x["pressure_zero"] * PRESSURE_ZERO
        miss = (lateral_stiffness(x, gauge, amplitude, SLOW, known) - stiffness) / HARMONIC_SCATTER
        return np.concatenate([miss.real, miss.imag, [x["pressure_zero"]]])

    return _in_units(fit(residuals, start), {"pressure_zero": PRESSURE_ZERO})


# -- all of it, and the file ---------------------------------------------------------------------------------------

FITTED: Final = ("effective_area", "bellows_volume", "membrane_length", "membrane_length_slope")
FITTED_LATERAL: Final = (
    "shell_stiffness_lateral",
    "friction_lateral",
    "friction_lateral_slope",
    "friction_lateral_travel",
)


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value (SI) with its confidence interval of 95 %."""

    value: float
    low: float
    high: float


def estimates(found: Fit, names: Iterable[str]) -> dict[str, Estimate]:
    """Return the named values of a fit with their intervals."""
    return {name: Estimate(found[name], *found.interval(name)) for name in names}


@dataclass(frozen=True, slots=True)
class Identified:
    """Everything that was identified of a spring."""

    area_and_volume: Fit
    lateral: Fit

    @property
    def parameters(self) -> dict[str, Estimate]:
        """The fitted parameters, named as in the parameter files; κ_0 is that of the volume, free of friction."""
        return estimates(self.area_and_volume, FITTED) | estimates(self.lateral, FITTED_LATERAL)


def identify(
    offset: Iterable[Curve], pressure_aw0: Iterable[Curve], pressure_aw3: Iterable[Curve], base: str
) -> Identified:
    """Identify a spring from the curves of ``lateral_offset`` and of both plans ``lateral_pressure``.

    ``base`` is the text of the parameter file to begin with. NotIdentified if something is missing.
    """
    known, kept = Known(base), list(offset)
    return Identified(
        fit_area_and_volume([isolated(kept, load) for load in (AW0, AW3)], known),
        fit_lateral_stiffness([sheared(pressure_aw0, AW0), sheared(pressure_aw3, AW3)], known),
    )


_ENTRY: Final = r"^{name} = \{{.*\}}$"


def write_parameters(path: Path | str, base: str, fitted: Mapping[str, Estimate], source: str) -> Path:
    """Write ``base`` (the text of a parameter file) with the ``fitted`` values in place of its own; return the path.

    Each gets the provenance "measured", its interval and ``source``, which names the record. NotIdentified, and no
    file, for a parameter that the base lacks or a value outside its range there.
    """
    entries = Known(base)._entries
    text = base
    for name, one in fitted.items():
        entry = entries.get(name)
        if entry is None:
            raise NotIdentified(f"the base parameter file has no {name}")
        unit = entry["unit"]
        value, low, high = (number / _UNITS[unit] for number in (one.value, one.low, one.high))
        if not entry["min"] <= value <= entry["max"]:
            raise NotIdentified(
                f"{name} = {value:.6g} {unit} is outside {entry['min']:g} to {entry['max']:g} {unit}"
            )
        told = f"{source}; 95 % within {low:.5g} to {high:.5g} {unit}".replace("\\", "/").replace('"', "'")
        line = (
            f'{{ value = {value:.7g}, unit = "{unit}", min = {entry["min"]}, max = {entry["max"]}, '
            f'provenance = "measured", source = "{told}" }}'
        )
        text, count = re.subn(
            _ENTRY.format(name=re.escape(name)),
            f"{name} = {line}".replace("\\", r"\\"),
            text,
            flags=re.MULTILINE,
        )
        if count != 1:
            raise NotIdentified(
                f"{name} stands {count} times on a line of its own in the base file; once is right"
            )
    target = Path(path)
    target.write_text(text, encoding="utf-8")
    return target
