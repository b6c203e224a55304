"""Step 3, noise: what a linear model of everything leaves, and by how much scores scatter more than that.

Theory of operation
-------------------
Scores are measured in standard deviations of the noise. Taken from the errors of the base model, the noise would hold
the very effect that is looked for; data sheets know neither its spectrum nor the day. So everything that anybody will
look for is fitted away first, by linear least squares: all parameters of the model, the footprints of all candidates,
the coefficients of all surfaces. Whatever is there, nothing of it is in the leftover, and `noise.estimate` makes an
autoregression of each channel of it (`leftover_noise`). Residuals and footprints pass the same whitening filter;
after that, noise is white and has variance 1.

No filter of single channels sees what lasts, or what several channels share: errors of the model's form, of the
inputs. The sandwich estimate of robust statistics does (`overdispersion`): the variance of a score is the sum of
squares of what the blocks of a run contribute to it, each block far longer than the noise remembers. Where scores
scatter more than whitened noise allows, they count less by the excess: each candidate's score by its own, χ² and
precisions by the median over all candidates (`Noise.dispersion`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.contracts import Array
from diagnosis.engine.columns import Columns, packing_of
from diagnosis.engine.config import DISPERSION_BLOCKS, VISIBLE_PART
from diagnosis.engine.fitting.linear import Block, Linearisation, Projection
from diagnosis.engine.fitting.linearise import from_quotients
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.footprints import Footprints
from diagnosis.engine.noise import Noise, estimate, quietest, white
from diagnosis.engine.threads import in_threads
from diagnosis.engine.whitening import filters


def leftover_noise(replay: Replay, around: Footprints) -> Noise:
    """Return the noise that a linear fit leaves of the model's own columns and of everything that is looked for.

    The fit weighs each channel by the root mean square of its errors, since the noise is not known yet.
    """
    point, channels = around.point, replay.simulator.channels
    residuals = replay.residuals(around.predictions)
    masks = [run.counted for run in replay.runs]
    deviations = []
    for i, channel in enumerate(channels):
        errors = np.concatenate([r[m[:, i], i] for r, m in zip(residuals, masks, strict=True)])
        deviations.append(max(float(np.sqrt(np.mean(errors**2))), quietest(channel), 1e-150))
    whiten = filters(white(deviations), replay.runs)
    linear = from_quotients(replay, point, whiten, residuals, around.parameter_columns)
    extra = (f.columns(parts) for f, parts in zip(whiten, around.looked_for, strict=True))
    projection = linear.project(extra, replay.workers)
    amplitudes = projection.estimate
    numbers = linear.step() - projection.regression @ amplitudes

    def leftover(r: int) -> Array:
        run, parts = replay.runs[r], around.looked_for[r]
        ends = np.cumsum([part.size for part in parts])[:-1]
        explained = around.parameter_columns[r].along(numbers[point.places_of(run.experiment.record)])
        for part, mine in zip(parts, np.split(amplitudes, ends), strict=True):
            explained += part.along(mine)
        return residuals[r] - packing_of(run).spread(explained)

    leftovers = in_threads(replay.workers, leftover, range(len(replay.runs)))
    spent = len(numbers) + int(np.linalg.matrix_rank(projection.cosines, tol=VISIBLE_PART))
    return estimate(channels, leftovers, masks, spent=spent)


def overdispersion(
    linearisation: Linearisation,
    columns: Sequence[Columns],
    projection: Projection,
    directions: Array | None = None,
    workers: int = 1,
) -> Array:
    """Return by how much the scores of columns scatter more than whitened noise allows (m,), at least 1.

    ``projection`` is that of the ``columns`` of each run. For sums of columns, each row of ``directions`` (v, m) holds
    the coefficients of one sum. What the columns explain together counts as no error, so that an effect does not hide
    itself. So many ``workers`` share the runs.
    """
    directions = np.eye(columns[0].size) if directions is None else directions
    seen = projection.along(directions)
    explained = directions.T @ seen.estimate
    imitated = projection.regression @ explained
    length = max(1, sum(len(block.packing.counted) for block in linearisation.blocks) // DISPERSION_BLOCKS)

    def scatter(pair: tuple[Block, Columns]) -> tuple[Array, int]:
        block, extra = pair
        error = block.residual - extra.along(explained) + block.along(imitated)
        stretches = block.packing.blocks(length)
        own = np.concatenate([x.by_block(error, stretches) for _, x in block.parts])
        score = extra.by_block(error, stretches) - projection.regression[block.places].T @ own
        return np.sum((directions @ score) ** 2, axis=1), stretches.shape[1] - 1

    runs = in_threads(workers, scatter, zip(linearisation.blocks, columns, strict=True))
    squares, count = sum((one for one, _ in runs), np.zeros(len(directions))), sum(n for _, n in runs)
    expected = seen.norm**2
    ratio = np.divide(squares, expected, out=np.ones_like(squares), where=seen.norm > 0.0)
    return np.maximum(ratio * count / max(count - 1, 1), 1.0)
