"""Tests of a residual alone: size by frequency band, correlation in time, drift."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from diagnosis.contracts import Array
from diagnosis.engine.config import DRIFT_BLOCKS, LEAST_SAMPLES, LJUNG_BOX_LAGS
from diagnosis.engine.p_values import bonferroni, p_of_chi2
from diagnosis.engine.residual.residuals import Evidence, NotApplicable, Residuals, input_name
from diagnosis.estimates import numbers
from diagnosis.finding import Figure, Series

#: Causes of an error that changes with time.
DRIFTS = "leak, heat, drift, volume"
BANDS_HZ = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)


def size(residuals: Residuals, c: int) -> Evidence | NotApplicable:
    """Test the ratio χ²/N in frequency bands: power of the whitened error over that of the noise."""
    white = residuals.whitened[:, c]
    known = np.isfinite(white)
    n = int(known.sum())
    if n < LEAST_SAMPLES:
        return NotApplicable(f"{n} samples are too few")
    power = np.abs(np.fft.rfft(np.nan_to_num(white)))[1:-1] ** 2 / n
    frequency = np.fft.rfftfreq(white.size, residuals.step)[1:-1]
    bands = [(a, b, (frequency > a) & (frequency <= b)) for a, b in pairwise(BANDS_HZ)]
    bands = [band for band in bands if band[2].any()]
    ratios = np.array([power[inside].mean() for _, _, inside in bands])
    counts = np.array([inside.sum() for _, _, inside in bands])
    worst = int(np.argmax((ratios - 1.0) * np.sqrt(counts)))
    low, high, _ = bands[worst]
    total = float(np.nanmean(white**2))
    name = residuals.channels[c].name
    return Evidence(
        statistic=float(ratios[worst]),
        p=bonferroni(p_of_chi2(2.0 * ratios[worst] * counts[worst], 2 * int(counts[worst])), len(bands)),
        sentence=f"the error of {name} is {np.sqrt(total):.3g} times the noise; from {low:g} to {high:g} Hz, it is "
        f"{np.sqrt(ratios[worst]):.3g} times the noise in this band",
        points_to="any cause",
        draw=lambda: Figure(
            kind="bars",
            x_label="upper end of the frequency band in Hz",
            y_label="error power / noise power",
            series=[Series(name=name, x=numbers([b for _, b, _ in bands]), y=numbers(ratios))],
            limit=1.0,
            logarithmic=True,
        ),
    )


def memory(residuals: Residuals, c: int) -> Evidence | NotApplicable:
    """Test the autocorrelation by Ljung and Box, Q = Σ n_h ρ_h² over the first lags, in a form that tolerates gaps."""
    white = residuals.whitened[:, c]
    known = np.isfinite(white)
    n = int(known.sum())
    if n < 5 * LJUNG_BOX_LAGS:
        return NotApplicable(f"{n} samples are too few")
    e = np.where(known, white - np.nanmean(white), 0.0)
    pairs = _self_products(known.astype(np.float64), LJUNG_BOX_LAGS)
    rho = _self_products(e, LJUNG_BOX_LAGS) / np.maximum(pairs, 1.0) / (e @ e / n)
    q = float(pairs @ rho**2)
    lag = int(np.argmax(np.abs(rho))) + 1
    name = residuals.channels[c].name
    return Evidence(
        statistic=q,
        p=p_of_chi2(q, LJUNG_BOX_LAGS),
        sentence=f"values of the error of {name} that are {lag * residuals.step:.3g} s apart have a correlation "
        f"of {rho[lag - 1]:.2f}",
        points_to="lag, delay, fast dynamics",
        draw=lambda: Figure(
            kind="bars",
            x_label="time between two values in s",
            y_label="correlation of the error",
            series=[
                Series(
                    name=name, x=numbers(residuals.step * np.arange(1, LJUNG_BOX_LAGS + 1)), y=numbers(rho)
                )
            ],
            limit=2.576 / float(np.sqrt(n)),
        ),
    )


def _self_products(values: Array, lags: int) -> Array:
    """Return Σ v_t v_{t+h} (lags,) for h = 1, 2, …."""
    return np.array([values[:-h] @ values[h:] for h in range(1, lags + 1)])


def drift(residuals: Residuals, c: int) -> Evidence | NotApplicable:
    """Test the means of blocks at three scales: for each block z = Σ e/√n, and the squares of z sum to χ².

    The part that follows the input is subtracted first, because means of slow cycles would look like a drift.
    """
    if int(np.isfinite(residuals.whitened[:, c]).sum()) < LEAST_SAMPLES:
        return NotApplicable("too few samples")
    white = _unmoved(residuals, c, residuals.whitened[:, c])
    best: tuple[float, float, int] | None = None
    for blocks in DRIFT_BLOCKS:
        sums, counts = _blocks(white, blocks)
        used = counts > 0
        value = float(np.sum(sums[used] ** 2 / counts[used]))
        p = p_of_chi2(value, int(used.sum()))
        if best is None or p < best[1]:
            best = (value, p, blocks)
    assert best is not None  # there is at least one scale
    value, p, blocks = best
    channel, seconds = residuals.channels[c], white.size * residuals.step / blocks
    sums, counts = _blocks(_unmoved(residuals, c, residuals.residual[:, c]), blocks)
    means = np.divide(sums, counts, out=np.full(blocks, np.nan), where=counts > 0) / channel.scale
    unit, name = channel.display or channel.unit, residuals.partner(c)
    without = f" without the part that depends on {input_name(name)}" if name else ""
    without = " after subtraction of a smooth curve over time" if name == "time" else without
    return Evidence(
        statistic=value,
        p=bonferroni(p, len(DRIFT_BLOCKS)),
        sentence=f"the error of {channel.name}{without}, averaged over {seconds:.2g} s, varies from "
        f"{np.nanmin(means):.3g} to {np.nanmax(means):.3g} {unit}",
        points_to=DRIFTS,
        draw=lambda: Figure(
            kind="points",
            x_label="time in s",
            y_label=f"mean error in {unit}",
            series=[
                Series(name=channel.name, x=numbers(seconds * (np.arange(blocks) + 0.5)), y=numbers(means))
            ],
        ),
    )


def _unmoved(residuals: Residuals, c: int, values: Array) -> Array:
    """Return values (n,) minus the part that follows an input, the one that the channel follows best."""
    name = residuals.partner(c)
    if not name:
        return values
    columns, known = residuals.regressors[name], np.isfinite(values)
    found = np.linalg.lstsq(columns[known], values[known], rcond=1e-9)[0]
    found[1] = 0.0  # keep the line in time: the test looks for it
    return values - columns @ found


def _blocks(values: Array, blocks: int) -> tuple[Array, Array]:
    """Return sums and counts (blocks,) of finite values in equal stretches of a run."""
    starts = (np.arange(blocks) * values.size) // blocks
    return (
        np.add.reduceat(np.nan_to_num(values), starts),
        np.add.reduceat(np.isfinite(values).astype(np.float64), starts),
    )
