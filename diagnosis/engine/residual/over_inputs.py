"""Tests of a residual against the inputs: odd and even dependence, and surfaces over two states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from diagnosis.contracts import Array
from diagnosis.engine.config import LEAST_IN_BIN, LEAST_OF_A_SINE, LEAST_SAMPLES, SURFACE_BINS
from diagnosis.engine.p_values import bonferroni, p_of_chi2
from diagnosis.engine.residual.over_time import DRIFTS
from diagnosis.engine.residual.residuals import (
    RATE,
    Evidence,
    NotApplicable,
    Residuals,
    input_axis,
    input_name,
    wald,
)
from diagnosis.engine.residual.stretches import Swing, harmonics
from diagnosis.estimates import numbers
from diagnosis.finding import Figure, Series

Parity = Literal["linear", "even", "odd"]
POINTS_TO = {
    "linear": "gain, stiffness, area, lag",
    "even": "area curve, asymmetric orifice, one-sided stop",
    "odd": "friction, bump stop, orifice",
}
#: Columns of `Residuals.regressors` that each kind tests beyond all others.
TESTED = {"linear": slice(2, 4), "even": slice(4, 6), "odd": slice(6, 8)}
ALL_HARMONICS = (1, 2, 3, 4, 5, 6, 7)
FIRST_HARMONICS = {"even": (2, 4, 6), "odd": (3, 5, 7)}


def follows(parity: Parity) -> Callable[[Residuals, int], Evidence | NotApplicable]:
    """Return a test of the regression of the error on an input: linear (u, u̇), or beyond that even (u², u u̇) or odd
    (sgn u̇, u³).

    A drift in time is subtracted first. Each regressor comes with its slope, so that the phase shift of a whitening
    filter does not hide it.
    """

    def test(residuals: Residuals, c: int) -> Evidence | NotApplicable:
        white = residuals.whitened[:, c]
        known = np.isfinite(white)
        if not residuals.inputs or known.sum() < LEAST_SAMPLES:
            return NotApplicable("no input changes" if not residuals.inputs else "too few samples")
        y = white[known]
        best: tuple[float, float, str] | None = None
        for name, regressors in residuals.regressors.items():
            columns = regressors[:, : 4 if parity == "linear" else 8]
            value, freedom = wald(columns[known], y, TESTED[parity])
            p = p_of_chi2(value, freedom)
            if best is None or (p, -value) < (best[0], -best[1]):
                best = (p, value, name)
        assert best is not None  # at least one input moves
        p, value, name = best
        share = float(np.sqrt(value / (y @ y)))
        ends = "the start and the end" if name == "time" else f"low and high {input_name(name)}"
        how = {
            "linear": f"has a part proportional to {_with_rate(name)}",
            "even": f"has a part with the same sign at {ends}",
            "odd": f"has a part that is not linear in {input_name(name)}",
        }[parity]
        return Evidence(
            statistic=value,
            p=bonferroni(p, len(residuals.inputs)),
            sentence=f"the error of {residuals.channels[c].name} {how} "
            f"(correlation after the noise filter: {share:.2f})",
            points_to=DRIFTS if name == "time" else POINTS_TO[parity],
            draw=lambda: _over_input(residuals, c, name),
        )

    return test


def _with_rate(name: str) -> str:
    """Return an input and its rate of change as text; both are tested together."""
    return "time" if name == "time" else f"{input_name(name)} or its rate of change"


def _over_input(residuals: Residuals, c: int, name: str) -> Figure:
    channel, u = residuals.channels[c], residuals.inputs[name]
    known = np.flatnonzero(np.isfinite(residuals.residual[:, c]))
    shown = known[:: max(1, known.size // 1200)]
    return Figure(
        kind="cloud",
        x_label=input_axis(name),
        y_label=f"error in {channel.display or channel.unit}",
        series=[
            Series(
                name=channel.name,
                x=numbers(u[shown]),
                y=numbers(residuals.residual[shown, c] / channel.scale),
            )
        ],
    )


def rings(parity: Parity) -> Callable[[Residuals, int], Evidence | NotApplicable]:
    """Return a test of the harmonics of the error while an input is a sine: even ones (2, 4, 6) or odd ones (3, 5, 7).

    The part that correlates with the measured input, including its harmonics, is subtracted first.
    """

    def test(residuals: Residuals, c: int) -> Evidence | NotApplicable:
        orders = FIRST_HARMONICS[parity]
        sines = [
            s
            for s in distinct(residuals.swings)
            if s.sine and orders[-1] * s.frequency < 0.45 / residuals.step
        ]
        sines = [
            s for s in sines if np.isfinite(residuals.whitened[s.start : s.stop, c]).sum() > LEAST_OF_A_SINE
        ]
        if not sines:
            return NotApplicable("no input is a sine")
        tests = [(*_ringing(residuals, c, sine, orders), sine) for sine in sines]
        value, freedom, sine = min(tests, key=lambda test: (p_of_chi2(test[0], test[1]), -test[0]))
        channel, sizes = residuals.channels[c], _amplitudes(residuals, c, sine)[np.array(orders) - 1]
        unit, largest = channel.display or channel.unit, int(np.argmax(sizes))
        return Evidence(
            statistic=value,
            p=bonferroni(p_of_chi2(value, freedom), len(sines)),
            sentence=f"the error of {channel.name} has a part of {sizes[largest] / channel.scale:.3g} {unit} at "
            f"{orders[largest]} times {sine.frequency:.3g} Hz, the frequency of {input_name(sine.signal)}",
            points_to=POINTS_TO[parity],
            draw=lambda: _spectrum(residuals, c, sine),
        )

    return test


def distinct(swings: Sequence[Swing]) -> list[Swing]:
    """Return the swings without duplicates. If several inputs move together, one swing remains."""
    kept: list[Swing] = []
    for swing in swings:
        period = (swing.stop - swing.start) / (len(swing.edges) - 1)
        if not any(
            abs(swing.start - other.start) < period
            and abs(swing.stop - other.stop) < period
            and abs(swing.frequency - other.frequency) < 0.02 * other.frequency
            for other in kept
        ):
            kept.append(swing)
    return kept


def _ringing(residuals: Residuals, c: int, sine: Swing, orders: tuple[int, ...]) -> tuple[float, int]:
    """Return χ² of the harmonics ``orders`` in the error during one sine, and its degrees of freedom."""
    inside = slice(sine.start, sine.stop)
    known = np.isfinite(residuals.whitened[inside, c])
    n, u = sine.stop - sine.start, residuals.inputs[sine.signal][inside]
    x = (u - u.mean()) / u.std()
    base = [np.ones((n, 1)), np.linspace(-1.0, 1.0, n)[:, None], x[:, None], np.gradient(x)[:, None]]
    base += [harmonics(n, residuals.step, sine.frequency, k) for k in ALL_HARMONICS if k not in orders]
    tested = [harmonics(n, residuals.step, sine.frequency, k) for k in orders]
    columns = np.hstack([*base, *tested])[known]
    return wald(
        columns, residuals.whitened[inside, c][known], slice(columns.shape[1] - 2 * len(orders), None)
    )


def _amplitudes(residuals: Residuals, c: int, sine: Swing) -> Array:
    """The amplitudes (7,) in SI of the harmonics of the error."""
    inside = slice(sine.start, sine.stop)
    known = np.isfinite(residuals.residual[inside, c])
    n = sine.stop - sine.start
    waves = [harmonics(n, residuals.step, sine.frequency, k) for k in ALL_HARMONICS]
    columns = np.hstack([np.ones((n, 1)), *waves])[known]
    raw = np.linalg.lstsq(columns, residuals.residual[inside, c][known], rcond=None)[0][1:]
    return np.hypot(raw[0::2], raw[1::2])


def _spectrum(residuals: Residuals, c: int, sine: Swing) -> Figure:
    channel = residuals.channels[c]
    return Figure(
        kind="bars",
        x_label=f"harmonic of {sine.frequency:.3g} Hz",
        y_label=f"error in {channel.display or channel.unit}",
        series=[
            Series(
                name=channel.name,
                x=numbers(ALL_HARMONICS),
                y=numbers(_amplitudes(residuals, c, sine) / channel.scale),
            )
        ],
    )


def velocity_surface(residuals: Residuals, c: int) -> Evidence | NotApplicable:
    """Test whether the error of channel ``c`` depends on an input x and its rate v, by its means in bins of (x, v)
    (Masri and Caughey 1979). The input is the one that the channel follows best.
    """
    name = residuals.partner(c)
    if not name:
        return NotApplicable("no input changes")
    u = residuals.inputs[name]
    return _surface(
        residuals,
        c,
        (input_name(name), u),
        (f"{RATE}{input_name(name)}", np.gradient(u, residuals.step)),
        "stop, friction, hysteresis",
    )


def pressure_surface(residuals: Residuals, c: int) -> Evidence | NotApplicable:
    """Test whether the error of channel ``c`` depends on an input x and a predicted pressure p, by its means in bins of
    (x, p). Input and pressure are those that the channel follows best.
    """
    pressures = [i for i, channel in enumerate(residuals.channels) if channel.kind == "pressure"]
    name = residuals.partner(c)
    if not pressures or not name:
        return NotApplicable("no input changes" if pressures else "no channel is a pressure")
    motion = (input_name(name), residuals.inputs[name])
    y = np.nan_to_num(residuals.measured[:, c] - np.nanmean(residuals.measured[:, c]))
    close = [
        abs(float(y @ (p - p.mean()))) / (p.std() or np.inf)
        for p in (residuals.predicted[:, i] for i in pressures)
    ]
    chosen = pressures[int(np.argmax(close))]
    pressure = (residuals.channels[chosen].name, residuals.predicted[:, chosen])
    return _surface(residuals, c, motion, pressure, "area curve, pressure gain, flow")


def _surface(
    residuals: Residuals, c: int, across: tuple[str, Array], up: tuple[str, Array], points_to: str
) -> Evidence | NotApplicable:
    known = np.isfinite(residuals.whitened[:, c])
    if known.sum() < SURFACE_BINS * SURFACE_BINS * LEAST_IN_BIN:
        return NotApplicable("too few samples for a surface")
    places = SURFACE_BINS * _quantile_bin(across[1][known]) + _quantile_bin(up[1][known])
    counts = np.bincount(places, minlength=SURFACE_BINS * SURFACE_BINS)
    filled = counts >= LEAST_IN_BIN
    if filled.sum() < 4:
        return NotApplicable("the run covers too little of the plane")
    white = residuals.whitened[known, c]
    sums = np.bincount(places, white, minlength=SURFACE_BINS * SURFACE_BINS)
    value = float(np.sum(sums[filled] ** 2 / counts[filled]))
    excess = float(white @ white) - white.size
    share = value / excess if excess > 0.0 else 1.0
    channel = residuals.channels[c]
    # Residuals at one place of the plane that differ from visit to visit come from something that is not in the plane.
    rest = (
        ""
        if share > 0.5
        else f". They explain only {100.0 * max(share, 0.0):.0f} % of it, so another quantity contributes"
    )

    def draw() -> Figure:
        def means(values: Array) -> list[float | None]:
            return numbers(
                np.bincount(places, values, minlength=SURFACE_BINS * SURFACE_BINS)[filled] / counts[filled]
            )

        series = Series(
            name=channel.name,
            x=means(across[1][known]),
            y=means(up[1][known]),
            z=means(residuals.residual[known, c] / channel.scale),
        )
        unit = channel.display or channel.unit
        return Figure(
            kind="map",
            x_label=input_axis(across[0]),
            y_label=input_axis(up[0]),
            z_label=f"error in {unit}",
            series=[series],
        )

    return Evidence(
        statistic=value,
        p=p_of_chi2(value, int(filled.sum())),
        sentence=f"the error of {channel.name} depends on {across[0]} and {up[0]}{rest}",
        points_to=points_to,
        draw=draw,
    )


def _quantile_bin(values: Array) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return the index of the bin of each value, for SURFACE_BINS equally filled bins."""
    edges = np.quantile(values, np.linspace(0.0, 1.0, SURFACE_BINS + 1)[1:-1])
    return np.searchsorted(edges, values).astype(np.int64)
