"""Step 3, noise: estimate it from the residual of a linear model of everything, and the excess scatter of scores.

Theory of operation
-------------------
Scores are measured in standard deviations of the noise. Residuals of the base model would include the effect to be
found, and data sheets do not give the spectrum of the noise. So all possible terms are fitted first, by linear least
squares: the parameters of the model, the footprints of all candidates, the coefficients of all surfaces. The remaining
residual contains no effect, and `noise.estimate` fits an autoregression to each channel of it (`leftover_noise`).
Residuals and footprints pass the same whitening filter; after that, the noise is white and has variance 1.

Filters of single channels do not show slow errors, or errors that several channels share, such as errors of the
equations and of the inputs. The sandwich estimate of robust statistics shows them (`overdispersion`): the variance of a
score is the sum of squares of the contributions of the blocks of a run. Each block is much longer than the correlation
time of the noise. If scores scatter more than whitened noise allows, they are reduced by the excess: each candidate's
score by its own, χ² and precisions by the median over all candidates (`Noise.dispersion`).
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
    """Return the noise from the residual of a linear fit of the model's columns and of all possible missing terms.

    The fit weights each channel by the root mean square of its errors, because the noise is not known yet.
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
    """Return the factors (m,), at least 1, by which the variance of the scores exceeds that of whitened noise.

    ``projection`` is that of the ``columns`` of each run. With ``directions`` (v, m) the factors (v,) are those of
    weighted sums of the columns. The part of the residual that the columns explain together is not counted as error;
    otherwise an effect would hide itself. The runs are divided among ``workers`` threads.
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
