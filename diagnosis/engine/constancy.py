"""Step 8, constancy: test whether a cause, and its effect on other parameters, is the same in all stretches.

Theory of operation
-------------------
If an equation of the model is slightly wrong, the most similar candidate imitates the error. For example, a wrong
relaxation of the rubber looks like an effect of the gas. The score of the wrong candidate is significant, so a
comparison with the noise does not show the mistake. But a wrong candidate would need another size or sign in each
stretch, and so would the base parameters that change with it. A true cause is the same everywhere.

This is Chow's test for the constancy of parameters (Econometrica 28:591, 1960), in the two directions that belong to
the cause: its column c, and its imitation by the other parameters, X β. Every run is cut into stretches. In the linear
model around the fit each stretch b gets separate amounts of both, D_b = (c, X β). The decrease of χ², minus its
expected value by chance, is

    E = Σ_b |P_b r_b|² − Σ_b (rank D_b − tr D_b⁺ X_b J⁻¹ X_bᵀ D_b⁺ᵀ),   P_b = D_b D_b⁺,

with the whitened residual r_b and the information J of the fit, priors included: If the equations are right, r has the
covariance 1 − X J⁻¹ Xᵀ, and E a mean of 0. The test uses whole runs, their halves, quarters and eighths: long stretches
show slow changes, short ones changes with each motion.

Rigs without hidden effects exceed chance too, because measured motions are inexact. Each effect has a factor for this,
measured on such rigs (`Hypothesis.overdispersion`).

The excess of E over both is the misfit from wrong equations in the directions of the cause. A cause whose own λ² is not
clearly larger may come from the same errors, and is not named. Errors in all other directions do not matter here. A
bench without hidden effects has about seventy directions in each stretch, with a small error in each. Together they
have a χ² of hundreds, and none of them looks like a leak.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.contracts import Array
from diagnosis.engine.config import CLEAR_OF_FORM, CONSTANCY_ALPHA, LEAST_EIGENVALUE, STRETCHES
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.fitting.linear import Block, Linearisation, inverse, solve
from diagnosis.engine.p_values import p_of_chi2
from diagnosis.engine.search_state import Accepted


def owed_to_form(model: FittedModel, accepted: Sequence[Accepted]) -> tuple[str, ...]:
    """Return the accepted effects of a fitted model whose λ² is not clearly above the misfit of its equations."""
    return tuple(
        one.effect for one in accepted if one.lambda_**2 < CLEAR_OF_FORM**2 * inconstancy(model, one.effect)
    )


def inconstancy(model: FittedModel, effect: str) -> float:
    """Return by how much χ² decreases if each stretch has its own amplitude, minus the usual decrease on rigs without
    hidden effects; 0 if not significant.
    """
    scatter = model.replay.simulator.catalogue[effect].overdispersion
    found = 0.0
    for chi2, freedom in changes(model, effect):
        if p_of_chi2(chi2 / scatter, round(freedom)) * len(STRETCHES) < CONSTANCY_ALPHA:
            found = max(found, chi2 - scatter * freedom)
    return found


def changes(model: FittedModel, effect: str) -> list[tuple[float, float]]:
    """Return two numbers for each division of the runs into stretches: the decrease of χ² if each stretch has its own
    amplitude, and the decrease expected by chance.
    """
    linearisation = model.linearisation
    directions = _directions(linearisation, effect)
    covariance = inverse(linearisation.information)
    stretches = [_stretches(block, directions) for block in linearisation.blocks]
    found = []
    for parts in STRETCHES:
        chi2, freedom = 0.0, 0.0
        for block, run in zip(linearisation.blocks, stretches, strict=True):
            own = directions[:, block.places]
            known = covariance[np.ix_(block.places, block.places)]
            for products in _merged(run, parts):
                explained, expected = _explained(own, products, known)
                chi2 += explained / model.noise.dispersion
                freedom += expected
        found.append((chi2, freedom))
    return found


def _directions(linearisation: Linearisation, effect: str) -> Array:
    """Return directions (2, k): the column of an effect's amplitude, and its best imitation by all other numbers."""
    information = linearisation.information
    amplitude = linearisation.point.place_of_amplitude(effect)
    others = np.arange(len(information)) != amplitude
    directions = np.zeros((2, len(information)))
    directions[0, amplitude] = 1.0
    directions[1, others] = solve(information[np.ix_(others, others)], information[others, amplitude])
    return directions


def _stretches(block: Block, directions: Array) -> Array:
    """Return the inner products (s, k, 3) of all columns with the residual and both directions, for each stretch of a
    run.
    """
    most = max(STRETCHES)
    edges = block.packing.blocks(-(-len(block.packing.counted) // most))
    edges = np.pad(edges, ((0, 0), (0, most + 1 - edges.shape[1])), "edge")  # a very short run has fewer
    products = [
        np.concatenate([columns.by_block(samples, edges) for _, columns in block.parts])
        for samples in (block.residual, *(block.along(numbers) for numbers in directions))
    ]
    return np.array(products).transpose(2, 1, 0)


def _merged(values: Array, parts: int) -> Array:
    """Return the sums over groups of adjacent values, so that ``parts`` sums remain."""
    merged: Array = values.reshape(parts, len(values) // parts, *values.shape[1:]).sum(axis=1)
    return merged


def _explained(directions: Array, products: Array, known: Array) -> tuple[float, float]:
    """Return the decrease of χ² by the directions (2, k) in a stretch, and the decrease expected by chance.

    ``products`` (k, 3) are those of `_stretches`; ``known`` (k, k) is the covariance of the fitted numbers.
    """
    mixed = products[:, 1:]
    gram = directions @ mixed
    diagonal = np.diagonal(gram)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, np.inf))
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    keep = values > LEAST_EIGENVALUE * max(values.max(initial=0.0), 1e-300)
    basis = scale[:, np.newaxis] * vectors[:, keep] / np.sqrt(values[keep])
    along = basis.T @ directions @ products[:, 0]
    imitated = mixed @ basis
    return float(along @ along), float(keep.sum() - np.sum(imitated * (known @ imitated)))
