"""Step 3: the noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from diagnosis.contracts import Array
from diagnosis.engine.fitting.linear import Linearisation, solve
from diagnosis.engine.fitting.linearise import from_quotients
from diagnosis.engine.fitting.point import Point
from diagnosis.engine.fitting.replay import Quotients, Replay
from diagnosis.engine.noise import Noise, estimate, filters, quietest, white

BLOCKS: Final = 256  #: of all runs together, to see how scores scatter


def remaining_noise(
    replay: Replay,
    point: Point,
    residuals: Sequence[Array],
    own: Sequence[Quotients],
    more: Sequence[Quotients],
) -> Noise:
    """Return the noise that a least-squares fit of all columns leaves: those of the point, and ``more`` (m, n, c)."""
    channels = replay.simulator.channels
    masks = [run.counted for run in replay.runs]
    rough = []
    for i, channel in enumerate(channels):
        errors = np.concatenate([r[m[:, i], i] for r, m in zip(residuals, masks, strict=True)])
        rough.append(max(float(np.sqrt(np.mean(errors**2))), quietest(channel), 1e-150))
    whiten = filters(white(rough), replay.runs)
    here = from_quotients(replay.names, point, whiten, residuals, own)
    projection = here.project([f.single(x) for f, x in zip(whiten, more, strict=True)])
    seen = projection.norm > 0.0
    others = np.zeros(len(seen))
    others[seen] = solve(projection.information[np.ix_(seen, seen)], projection.score[seen])
    mine = here.step() - projection.regression @ others
    leftovers = [
        residual - np.tensordot(mine[point.places_of(name)], x, 1) - np.tensordot(others, y, 1)
        for name, residual, x, y in zip(replay.names, residuals, own, more, strict=True)
    ]
    return estimate(
        channels, leftovers, masks, spent=len(mine) + int(np.linalg.matrix_rank(projection.cosines))
    )


def overdispersion(here: Linearisation, columns: Sequence[Quotients]) -> Array:
    """Return by how much the scores of columns (m, n, c) scatter more than whitened noise allows (m,), at least 1.

    The sandwich of robust statistics: the variance of a score is the sum of squares of what blocks of a run add to
    it, each far longer than the noise remembers. It sees what no whitening of single channels can: errors of the
    model and the inputs that last, or that several channels share. What the columns explain together counts as no
    error, so an effect does not hide itself.
    """
    projection = here.project(columns)
    seen = projection.norm > 0.0
    explained = np.zeros(len(seen))
    explained[seen] = solve(projection.information[np.ix_(seen, seen)], projection.score[seen])
    imitated = projection.regression @ explained
    length = max(1, sum(len(block.residual) for block in here.blocks) // BLOCKS)
    meat, count = np.zeros(len(seen)), 0
    for block, more in zip(here.blocks, columns, strict=True):
        error = block.residual - np.tensordot(explained, more, 1) + block.along(imitated)
        for start in range(0, len(error), length):
            inside = slice(start, start + length)
            part = error[inside].ravel()
            score = more[:, inside].reshape(len(seen), part.size) @ part
            own = [
                columns.values[:, inside].reshape(len(places), part.size) @ part
                for places, columns in block.parts
            ]
            score -= np.concatenate(own) @ projection.regression[block.places]
            meat += score**2
            count += 1
    square = projection.norm**2
    ratio = np.divide(meat, square, out=np.ones_like(meat), where=seen)
    return np.maximum(ratio * count / max(count - 1, 1), 1.0)
