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
from diagnosis.engine.config import DISPERSION_BLOCKS
from diagnosis.engine.fitting.linear import Linearisation, Projection, solve
from diagnosis.engine.fitting.linearise import from_quotients
from diagnosis.engine.fitting.replay import Quotients, Replay
from diagnosis.engine.footprints import Footprints
from diagnosis.engine.noise import Noise, estimate, filters, quietest, white


def leftover_noise(replay: Replay, around: Footprints, extra: Sequence[Quotients]) -> Noise:
    """Return the noise that a linear fit leaves of the model's own columns and of ``extra`` ones (m, n, c) by run.

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
    projection = linear.project([f.single(x) for f, x in zip(whiten, extra, strict=True)])
    amplitudes = _estimated(projection)
    numbers = linear.step() - projection.regression @ amplitudes
    leftovers = [
        residual - np.tensordot(numbers[point.places_of(record)], x, 1) - np.tensordot(amplitudes, y, 1)
        for record, residual, x, y in zip(
            replay.records, residuals, around.parameter_columns, extra, strict=True
        )
    ]
    spent = len(numbers) + int(np.linalg.matrix_rank(projection.cosines))
    return estimate(channels, leftovers, masks, spent=spent)


def overdispersion(linearisation: Linearisation, columns: Sequence[Quotients]) -> Array:
    """Return by how much the scores of columns (m, n, c) scatter more than whitened noise allows (m,), at least 1.

    What the columns explain together counts as no error, so that an effect does not hide itself.
    """
    projection = linearisation.project(columns)
    explained = _estimated(projection)
    imitated = projection.regression @ explained
    length = max(1, sum(len(block.residual) for block in linearisation.blocks) // DISPERSION_BLOCKS)
    squares, count = np.zeros(len(explained)), 0
    for block, extra in zip(linearisation.blocks, columns, strict=True):
        error = block.residual - np.tensordot(explained, extra, 1) + block.along(imitated)
        for start in range(0, len(error), length):
            inside = slice(start, start + length)
            part = error[inside].ravel()
            score = extra[:, inside].reshape(len(explained), part.size) @ part
            own = [x.values[:, inside].reshape(len(places), part.size) @ part for places, x in block.parts]
            score -= np.concatenate(own) @ projection.regression[block.places]
            squares += score**2
            count += 1
    expected = projection.norm**2
    ratio = np.divide(squares, expected, out=np.ones_like(squares), where=projection.norm > 0.0)
    return np.maximum(ratio * count / max(count - 1, 1), 1.0)


def _estimated(projection: Projection) -> Array:
    """Return the least-squares amplitudes (m,) of all projected columns together; 0 for an invisible one."""
    seen = projection.norm > 0.0
    amplitudes = np.zeros(len(seen))
    amplitudes[seen] = solve(projection.information[np.ix_(seen, seen)], projection.score[seen])
    return amplitudes
