"""The residuals of one run: measured minus predicted, the same whitened, and the motions of the inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from diagnosis.contracts import Array, Channel, Experiment
from diagnosis.engine.residual.stretches import Hold, Swing, holds, moving, swings
from diagnosis.finding import Figure


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of one run: ``residual`` (n, c) in SI, ``whitened`` (n, c) with unit variance; NaN where a sample does
    not count.

    ``inputs`` are those that move; ``swings`` and ``holds`` are their motions and pauses. Results that several tests
    use are cached.
    """

    experiment: Experiment
    channels: tuple[Channel, ...]
    measured: Array
    predicted: Array
    residual: Array
    whitened: Array
    inputs: Mapping[str, Array]
    swings: tuple[Swing, ...]
    holds: tuple[Hold, ...]

    @property
    def run(self) -> str:
        """Name of the run."""
        return self.experiment.name

    @property
    def step(self) -> float:
        """Sampling interval in s."""
        return self.experiment.step

    @cached_property
    def regressors(self) -> Mapping[str, Array]:
        """Columns (n, 8) of each input and of time: 1, t, u, u̇, u², u u̇, sgn u̇ (smooth), u³."""
        return {name: _regressors(u, self.step) for name, u in self.inputs.items()}

    def partner(self, c: int, start: int = 0, stop: int | None = None) -> str:
        """Return the input that a channel follows best, by its correlation with the input and its rate; "" if no input
        moves.
        """
        if (start, stop) not in self._partners:
            self._partners[start, stop] = self._follow(slice(start, stop))
        return self._partners[start, stop][c]

    @cached_property
    def _partners(self) -> dict[tuple[int, int | None], tuple[str, ...]]:
        return {}

    def _follow(self, inside: slice) -> tuple[str, ...]:
        known = self.measured[inside]
        count = np.maximum(np.isfinite(known).sum(axis=0), 1)
        y = np.nan_to_num(known - np.nansum(known, axis=0) / count)
        best, found = np.zeros(y.shape[1]), [""] * y.shape[1]
        for name, u in self.inputs.items():
            columns = np.column_stack((np.ones(len(y)), u[inside], np.gradient(u[inside])))
            explained, _ = _explained(columns, y, slice(1, 3))
            found = [name if more else old for more, old in zip(explained > best, found, strict=True)]
            best = np.maximum(best, explained)
        return tuple(found)


def _regressors(u: Array, step: float) -> Array:
    x = (u - np.median(u)) / u.std()
    v = np.gradient(x, step)
    v = v / (v.std() or 1.0)
    time = np.linspace(-1.0, 1.0, x.size)
    return np.column_stack((np.ones_like(x), time, x, v, x * x, x * v, np.tanh(2.0 * v), x**3))


def residuals_of(
    experiment: Experiment, channels: tuple[Channel, ...], measured: Array, predicted: Array, white: Array
) -> Residuals:
    """Return residuals from outputs (n, c) and whitened residuals ``white`` (n, c). ``white`` is NaN or exactly 0 where
    a sample does not count.
    """
    counts = np.isfinite(white) & (white != 0.0) & np.isfinite(measured)
    inputs = moving(experiment)
    return Residuals(
        experiment=experiment,
        channels=channels,
        measured=measured,
        predicted=predicted,
        residual=np.where(counts, measured - predicted, np.nan),
        whitened=np.where(counts, white, np.nan),
        inputs=inputs,
        swings=tuple(swing for name in inputs for swing in swings(experiment, name)),
        holds=tuple(holds(experiment)) if inputs else (),
    )


#: Texts of inputs whose names are not clear.
_NAMES = {"lateral.give": "lateral deflection of the frame"}


def input_name(name: str) -> str:
    """Return the name of an input as text: ``pressure_rate`` becomes "pressure rate". Names with a dot are not
    changed, except those in `_NAMES`.
    """
    return _NAMES.get(name, name if "." in name else name.replace("_", " "))


#: Units (SI) of usual inputs and pressures, by the end of their names.
_UNITS = {
    "time": "s",
    "displacement": "m",
    "deflection of the frame": "m",
    "height": "m",
    "speed": "m/s",
    "pressure": "Pa",
    "pressure_rate": "Pa/s",
    "pressure rate": "Pa/s",
}


#: Begin of the name of a rate of change.
RATE = "rate of "


def input_unit(name: str) -> str:
    """Return the SI unit of an input or a pressure by its name; "" if it is not known."""
    return next((unit for end, unit in _UNITS.items() if input_name(name).endswith(end)), "")


def input_axis(name: str) -> str:
    """Return the label of the axis of an input, a pressure, or the `RATE` of one, with its unit."""
    unit = input_unit(name) or "its SI unit"
    return f"{input_name(name)} in {unit}{'/s' if name.startswith(RATE) else ''}"


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Result of one test for one channel in one run; ``p`` includes the number of comparisons in the test."""

    statistic: float
    p: float
    sentence: str
    points_to: str
    draw: Callable[[], Figure] | None = None


@dataclass(frozen=True, slots=True)
class NotApplicable:
    """The reason why a test does not apply to a channel or a run."""

    why: str


def wald(columns: Array, y: Array, tested: slice) -> tuple[float, int]:
    """Return χ² and the degrees of freedom of the ``tested`` columns in addition to the others, for y (n,) of unit
    variance.

    ``columns`` is (n, k). A tested column that is a combination of the others adds no degree of freedom.
    """
    explained, freedom = _explained(columns, y[:, np.newaxis], tested)
    return float(explained[0]), freedom


def _explained(columns: Array, y: Array, tested: slice) -> tuple[Array, int]:
    """Return the result of `wald` for several y (n, c) at once."""
    norm = np.sqrt(np.einsum("nk,nk->k", columns, columns))
    scaled = columns / np.where(norm > 0.0, norm, 1.0)
    base = _basis(np.delete(scaled, np.arange(columns.shape[1])[tested], axis=1))
    own = _basis(scaled[:, tested] - base @ (base.T @ scaled[:, tested]))
    projection = own.T @ y - (own.T @ base) @ (base.T @ y)
    return np.sum(projection**2, axis=0), own.shape[1]


def _basis(columns: Array) -> Array:
    """Return an orthonormal basis (n, rank) of columns with at most unit norm."""
    values, vectors = np.linalg.eigh(columns.T @ columns)
    kept = values > 1e-10
    basis: Array = columns @ (vectors[:, kept] / np.sqrt(values[kept]))
    return basis
