"""Step 8, constancy: whether one set of parameters serves all stretches of all runs, as it does if the form is right.

Theory of operation
-------------------
A model whose form is a little wrong somewhere is imitated by whatever candidate comes nearest: rubber that forgets
otherwise than the model says is paid by the gas. No noise tells, for the score of the impostor is real. What tells is
that an impostor is nowhere quite right: here it would have to be larger, there smaller or of the other sign, and with
it the base parameters that make room for it. A true cause is the same everywhere.

This is Chow's test for the constancy of parameters (Econometrica 28:591, 1960). Every run is cut into stretches, and
each stretch is given parameters of its own, in the linear model around the fit. By how much χ² would fall is

    E = Σ_b r_bᵀ X_b (X_bᵀ X_b)⁺ X_bᵀ r_b,

with r_b and X_b the whitened residuals and sensitivities of stretch b: χ² with Σ_b rank X_b degrees of freedom, less
those that the common fit has used, where the form is right. It is asked of whole runs, of their halves, quarters and
eighths: what changes slowly shows in the former, what follows each motion in the latter.

What E exceeds chance by is the part of the misfit that the form of the model owes, in the directions in which anything
can be said. A cause whose own λ² is not clearly larger may be owed to the same, and is not named.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from diagnosis.contracts import Array
from diagnosis.engine.config import CLEAR_OF_FORM, CONSTANCY_ALPHA, LEAST_EIGENVALUE, STRETCHES
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.linear import Block, Linearisation, inverse
from diagnosis.engine.p_values import p_of_chi2
from diagnosis.engine.search_state import Accepted


def inconstancy(model: FittedModel) -> float:
    """Return the χ² beyond chance that parameters of each stretch's own would explain; 0 where chance may."""
    linearisation = model.linearisation
    stretches = [_stretches(block) for block in linearisation.blocks]
    used = _used(linearisation)
    found = 0.0
    for parts in STRETCHES:
        chi2, freedom = 0.0, -used
        for grams, scores in stretches:
            for gram, score in zip(_merged(grams, parts), _merged(scores, parts), strict=True):
                explained, rank = _explained(gram, score)
                chi2 += explained / model.noise.dispersion
                freedom += rank
        if p_of_chi2(chi2, round(freedom)) * len(STRETCHES) < CONSTANCY_ALPHA:
            found = max(found, chi2 - freedom)
    return found


def owed_to_form(accepted: Sequence[Accepted], excess: float) -> tuple[str, ...]:
    """Return the accepted effects whose trace is not clear of an ``excess``, that of `inconstancy`."""
    return tuple(one.effect for one in accepted if one.lambda_**2 < CLEAR_OF_FORM**2 * excess)


def _stretches(block: Block) -> tuple[Array, Array]:
    """Return the inner products of all columns (s, k, k), and with the residual (s, k), in the stretches of a run."""
    most = max(STRETCHES)
    edges = block.packing.blocks(-(-len(block.packing.counted) // most))
    edges = np.pad(edges, ((0, 0), (0, most + 1 - edges.shape[1])), "edge")  # a very short run has fewer
    scores = np.concatenate([columns.by_block(block.residual, edges) for _, columns in block.parts]).T
    grams = np.zeros((most, scores.shape[1], scores.shape[1]))
    (_, shared), (_, own) = block.parts
    for first, second, ends in zip(shared.traces, own.traces, edges, strict=True):
        rows = np.concatenate((first.rows, shared.size + second.rows))
        values = np.concatenate((first.double, second.double))
        for gram, (start, stop) in zip(grams, pairwise((ends - ends[0]).tolist()), strict=True):
            gram[np.ix_(rows, rows)] += values[:, start:stop] @ values[:, start:stop].T
    return grams, scores


def _merged(values: Array, parts: int) -> Array:
    """Return the sums over neighbours that leave so many ``parts``."""
    merged: Array = values.reshape(parts, len(values) // parts, *values.shape[1:]).sum(axis=1)
    return merged


def _explained(gram: Array, score: Array) -> tuple[float, int]:
    """Return the χ² that parameters of its own explain in a stretch, and how many it can tell apart."""
    diagonal = np.diagonal(gram)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, np.inf))
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    keep = values > LEAST_EIGENVALUE * max(values.max(initial=0.0), 1e-300)
    along = vectors[:, keep].T @ (scale * score)
    return float(np.sum(along**2 / values[keep])), int(keep.sum())


def _used(linearisation: Linearisation) -> float:
    """Return how many degrees of freedom the common fit has: what is believed beforehand takes none from the data."""
    information = linearisation.information
    data = information - linearisation.prior.precision
    return float(np.trace(inverse(information) @ data))
