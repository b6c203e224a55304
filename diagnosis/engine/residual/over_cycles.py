"""Tests of a residual in loops: their shape, their loss per cycle, and the error in a hold."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from diagnosis.contracts import Array, Channel
from diagnosis.engine.config import LEAST_CYCLES, LEAST_OF_A_HOLD, QUASI_STATIC_HZ, SETTLING_S
from diagnosis.engine.p_values import bonferroni, p_of_chi2, p_of_t
from diagnosis.engine.residual.residuals import (
    Evidence,
    NotApplicable,
    Residuals,
    input_axis,
    input_name,
    input_unit,
    wald,
)
from diagnosis.engine.residual.stretches import Hold, Swing
from diagnosis.estimates import numbers
from diagnosis.finding import Figure, Series


def loss(residuals: Residuals, c: int) -> Evidence | NotApplicable:
    """Test the loss per cycle W = ∮ y du, measured minus predicted, with Student's t over the cycles of a stretch.

    Its growth with amplitude A and frequency f shows the mechanism. Viscous: as A² f. Maxwell, heat or orifice: as A²,
    with a maximum over f. Coulomb or Berg friction: as A, independent of f.
    """
    if residuals.channels[c].kind not in {"force", "pressure"}:
        return NotApplicable("the channel is neither a force nor a pressure")
    swings = _followed(residuals, c)
    if not swings:
        return NotApplicable("no input oscillates regularly")
    found = [(swing, _losses(residuals, c, swing)) for swing in swings]
    tests = [(_against_zero(values), swing, float(values.mean())) for swing, values in found]
    (p, t), swing, mean = min(tests, key=lambda one: one[0])
    channel = residuals.channels[c]
    per = input_unit(swing.signal) or f"unit of {input_name(swing.signal)}"
    unit = f"{channel.display or channel.unit}·{per}"
    sure = [(s, w) for (chance, _), s, w in tests if chance < 0.01]
    return Evidence(
        statistic=abs(t),
        p=bonferroni(p, len(tests)),
        sentence=f"at {swing.frequency:.3g} Hz, the loss per cycle of {channel.name} is "
        f"{abs(mean) / channel.scale:.3g} {unit} {'larger' if mean > 0.0 else 'smaller'} than predicted",
        points_to=_mechanism(sure),
        draw=lambda: Figure(
            kind="points",
            x_label="frequency in Hz",
            y_label=f"loss per cycle / amplitude, in {channel.display or channel.unit}",
            series=[
                Series(
                    name=f"{input_name(s.signal)} ± {s.amplitude:.3g}",
                    x=numbers([s.frequency]),
                    y=numbers([w / s.amplitude / channel.scale]),
                )
                for _, s, w in tests
            ],
        ),
    )


def _followed(residuals: Residuals, c: int) -> list[Swing]:
    """Return the swings of the input that the channel follows best. Each has at least three cycles that are mostly
    measured.
    """
    chosen = [s for s in residuals.swings if residuals.partner(c, s.start, s.stop) == s.signal]
    return [s for s in chosen if _losses(residuals, c, s).size >= LEAST_CYCLES]


def _losses(residuals: Residuals, c: int, swing: Swing) -> Array:
    """Return ∮ e du of each cycle that is mostly measured (cycles,)."""
    e, u = residuals.residual[:, c], residuals.inputs[swing.signal]
    cycles = []
    for a, b in pairwise(swing.edges):
        known = np.isfinite(e[a:b])
        if known.mean() > 0.7:
            slope = np.gradient(u[a:b])
            centred = np.where(known, e[a:b] - np.nanmean(e[a:b]), 0.0)
            cycles.append(float(centred @ slope) / float(known.mean()))
    return np.array(cycles)


def _against_zero(values: Array) -> tuple[float, float]:
    """Return p and t for the hypothesis that the mean is 0."""
    error = float(values.std(ddof=1)) / np.sqrt(values.size)
    t = float(values.mean()) / error if error > 0.0 else 0.0
    return p_of_t(t, values.size - 1), t


def _mechanism(sure: list[tuple[Swing, float]]) -> str:
    """Return as text the mechanisms that fit the growth of a loss with amplitude and frequency, |W| ~ Aᵃ fᵇ."""
    anything = "friction, viscous or Maxwell loss, heat, orifice"
    if len({s.signal for s, _ in sure}) != 1 or len(sure) < 3:
        return anything
    logs = np.log([(s.amplitude, s.frequency, abs(w)) for s, w in sure])
    spread = np.ptp(logs[:, :2], axis=0) > np.log(1.5)
    columns = np.column_stack((np.ones(len(sure)), logs[:, :2][:, spread]))
    if not spread.any() or np.linalg.matrix_rank(columns) < columns.shape[1]:
        return anything
    powers = np.full(2, np.nan)
    powers[spread] = np.linalg.lstsq(columns, logs[:, 2], rcond=None)[0][1:]
    a, b = powers
    flat, quadratic = not spread[1] or abs(b) < 0.25, not spread[0] or a > 1.6
    if spread[0] and a < 1.4 and flat:
        return "Coulomb or Berg friction"
    if quadratic and spread[1] and b > 0.6:
        return "viscous loss, or Maxwell branch below its frequency of maximum loss"
    if quadratic and spread[1] and b < 0.25:
        return "Maxwell branch, heat or orifice, near or above the frequency of maximum loss"
    return anything


def quasi_static(residuals: Residuals, c: int) -> Evidence | NotApplicable:
    """Test the width of the error's loop at two low speeds: equal for friction, growing for a Maxwell branch."""
    if residuals.channels[c].kind != "force":
        return NotApplicable("the channel is not a force")
    slow = sorted(
        (s for s in _followed(residuals, c) if s.frequency <= QUASI_STATIC_HZ), key=lambda s: s.frequency
    )
    pairs = [
        (a, b)
        for i, a in enumerate(slow)
        for b in slow[i + 1 :]
        if b.frequency > 1.5 * a.frequency
        and abs(a.amplitude - b.amplitude) < 0.2 * a.amplitude
        and a.signal == b.signal
    ]
    if not pairs:
        return NotApplicable("no input oscillates slowly at two speeds")
    first, second = pairs[0]
    widths = [_losses(residuals, c, s) / (4.0 * s.amplitude) for s in (first, second)]
    tests = [_against_zero(w) for w in widths]
    apart = abs(float(widths[1].mean() - widths[0].mean()))
    error = float(np.sqrt(sum(w.var(ddof=1) / w.size for w in widths)))
    channel = residuals.channels[c]
    shown = [float(w.mean()) / channel.scale for w in widths]
    unit = channel.display or channel.unit
    same = apart < 3.0 * error or apart < 0.15 * max(abs(float(w.mean())) for w in widths)
    return Evidence(
        statistic=max(abs(t) for _, t in tests),
        p=bonferroni(min(p for p, _ in tests), 2),
        sentence=f"half the width of the loop of {channel.name} differs from the prediction by {shown[0]:.3g} {unit} "
        f"at {first.frequency:.3g} Hz and by {shown[1]:.3g} {unit} at {second.frequency:.3g} Hz, so it "
        + ("does not depend on the speed" if same else "depends on the speed"),
        points_to="Berg or Coulomb friction" if same else "Maxwell, viscous loss",
        draw=lambda: Figure(
            kind="lines",
            x_label=input_axis(first.signal),
            y_label=f"error in {unit}",
            series=[_loop(residuals, c, swing, channel) for swing in (first, second)],
        ),
    )


def _loop(residuals: Residuals, c: int, swing: Swing, channel: Channel) -> Series:
    a, b = swing.edges[1], swing.edges[2]
    step = max(1, (b - a) // 300)
    return Series(
        name=f"{swing.frequency:.3g} Hz",
        x=numbers(residuals.inputs[swing.signal][a:b:step]),
        y=numbers(residuals.residual[a:b:step, c] / channel.scale),
    )


def settles(residuals: Residuals, c: int) -> Evidence | NotApplicable:
    """Test the error in holds, in which all inputs are at rest: does it follow a line or an exponential?"""
    white = residuals.whitened[:, c]
    holds = [h for h in residuals.holds if np.isfinite(white[h.start : h.stop]).sum() > LEAST_OF_A_HOLD]
    if not holds:
        return NotApplicable("no input stays constant")
    looks = len(holds) * (1 + len(SETTLING_S))
    tests = [
        (*_in_hold(white, hold, residuals.step, tau), hold) for hold in holds for tau in (0.0, *SETTLING_S)
    ]
    p, value, tau, hold = min(tests, key=lambda test: (test[0], -test[1]))
    channel, inside = residuals.channels[c], slice(hold.start, hold.stop)
    e = residuals.residual[inside, c] / channel.scale
    known = np.isfinite(e)
    time: Array = residuals.step * np.arange(e.size, dtype=np.float64)
    shape = np.exp(-time / tau) if tau else time
    columns = np.column_stack((np.ones(e.size), shape))
    size = np.linalg.lstsq(columns[known], e[known], rcond=None)[0][1]
    unit = channel.display or channel.unit
    return Evidence(
        statistic=value,
        p=bonferroni(p, looks),
        sentence=f"in a hold of {e.size * residuals.step:.3g} s the error of {channel.name} "
        + (
            f"changes by {-size:+.3g} {unit} and settles within about {tau:g} s"
            if tau
            else f"drifts by {60.0 * size:+.3g} {unit} per minute and does not stop"
        ),
        points_to="heat exchange, Maxwell branch, creep" if tau else "leak, drift of a sensor",
        draw=lambda: _settling(channel, unit, time, e),
    )


def _in_hold(white: Array, hold: Hold, step: float, tau: float) -> tuple[float, float, float]:
    """Return p, χ² and τ of an exponential in addition to a constant. τ = 0 tests a line instead."""
    y = white[hold.start : hold.stop]
    known = np.isfinite(y)
    time = step * np.arange(y.size)
    columns = np.column_stack((np.ones(y.size), np.exp(-time / tau) if tau else time))
    value, freedom = wald(columns[known], y[known], slice(1, 2))
    return p_of_chi2(value, freedom), value, tau


def _settling(channel: Channel, unit: str, time: Array, e: Array) -> Figure:
    width = max(1, e.size // 200)
    blocks = e[: e.size // width * width].reshape(-1, width)
    known = np.isfinite(blocks).sum(axis=1)
    means = np.divide(np.nansum(blocks, axis=1), known, out=np.full(known.size, np.nan), where=known > 0)
    return Figure(
        kind="points",
        x_label="time since the start of the hold in s",
        y_label=f"error in {unit}",
        series=[Series(name=channel.name, x=numbers(time[::width][: means.size]), y=numbers(means))],
    )
