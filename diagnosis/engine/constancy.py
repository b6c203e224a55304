"""Step 8, constancy: whether a cause, and its effect on other parameters, is the same in all stretches.

Theory of operation
-------------------
A model whose form is a little wrong somewhere is imitated by whatever candidate comes nearest: rubber that forgets
differently than the model says is paid by the gas. The noise does not show this, because the score of the impostor is
real. But an impostor is nowhere quite right: here it would have to be larger, there smaller or of the other sign, and
with it the base parameters that make room for it. A true cause is the same everywhere.

This is Chow's test for the constancy of parameters (Econometrica 28:591, 1960), in the two directions that belong to
the cause: its column c, and its imitation by the other parameters, X β. Every run is cut into stretches. Each stretch b
gets a separate amount of each, D_b = (c, X β), in the linear model around the fit. By how much χ² would fall, less what
chance does, is

    E = Σ_b |P_b r_b|² − Σ_b (rank D_b − tr D_b⁺ X_b J⁻¹ X_bᵀ D_b⁺ᵀ),   P_b = D_b D_b⁺,

with the whitened residual r_b and the information J of the fit, priors included: r has the covariance 1 − X J⁻¹ Xᵀ if
the form is right, and E a mean of 0. It is tested on whole runs, their halves, quarters and eighths: slow changes show
in the former, changes with each motion in the latter.

Sound rigs exceed chance too, because measured motions are inexact: each effect has its own factor, measured on rigs in
which nothing is hidden (`Hypothesis.overdispersion`), and that much is no news of the form.

The excess of E over both is the part of the misfit that the form of the model owes where the cause is distinguished
from. A cause whose own λ² is not clearly larger may be owed to the same, and is not named. In all other directions the
form may owe what it will. A healthy bench has some seventy of them in each stretch, and a little is wrong in each.
Together that is a χ² of hundreds, and nothing of it looks like a leak.
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
    """Return the accepted effects of a fitted model whose trace is not clear of what its form owes."""
    return tuple(
        one.effect for one in accepted if one.lambda_**2 < CLEAR_OF_FORM**2 * inconstancy(model, one.effect)
    )


def inconstancy(model: FittedModel, effect: str) -> float:
    """Return the χ² by which an effect of each stretch's own explains more than on sound rigs; 0 where chance may."""
    scatter = model.replay.simulator.catalogue[effect].overdispersion
    found = 0.0
    for chi2, freedom in changes(model, effect):
        if p_of_chi2(chi2 / scatter, round(freedom)) * len(STRETCHES) < CONSTANCY_ALPHA:
            found = max(found, chi2 - scatter * freedom)
    return found


def changes(model: FittedModel, effect: str) -> list[tuple[float, float]]:
    """Return the χ² that an effect of each stretch's own would explain, and its mean by chance, for each cutting."""
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
    """Return the numbers (2, k) that make the column of an effect's amplitude, and its best imitation by all others."""
    information = linearisation.information
    amplitude = linearisation.point.place_of_amplitude(effect)
    others = np.arange(len(information)) != amplitude
    directions = np.zeros((2, len(information)))
    directions[0, amplitude] = 1.0
    directions[1, others] = solve(information[np.ix_(others, others)], information[others, amplitude])
    return directions


def _stretches(block: Block, directions: Array) -> Array:
    """Return the inner products (s, k, 3) of all columns with residual and directions in the stretches of a run."""
    most = max(STRETCHES)
    edges = block.packing.blocks(-(-len(block.packing.counted) // most))
    edges = np.pad(edges, ((0, 0), (0, most + 1 - edges.shape[1])), "edge")  # a very short run has fewer
    products = [
        np.concatenate([columns.by_block(samples, edges) for _, columns in block.parts])
        for samples in (block.residual, *(block.along(numbers) for numbers in directions))
    ]
    return np.array(products).transpose(2, 1, 0)


def _merged(values: Array, parts: int) -> Array:
    """Return the sums over neighbours that leave so many ``parts``."""
    merged: Array = values.reshape(parts, len(values) // parts, *values.shape[1:]).sum(axis=1)
    return merged


def _explained(directions: Array, products: Array, known: Array) -> tuple[float, float]:
    """Return the χ² that the directions (2, k) explain in a stretch, and its mean by chance.

    ``products`` (k, 3) are those of `_stretches`, ``known`` (k, k) is the covariance of the fit's numbers.
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
