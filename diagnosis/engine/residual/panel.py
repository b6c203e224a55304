"""Step 1, the residual panel: the errors of the base model and where they occur, without a name for the cause.

Theory of operation
-------------------
The measured motion drives the model; the residual is measured minus predicted. Every test examines one channel in one
run, without an assumed cause: size against the noise in frequency bands, autocorrelation, drift (`over_time.py`); odd
and even dependence on the inputs, and surfaces over two states (`over_inputs.py`); loss per cycle, loops and holds
(`over_cycles.py`); combinations of channels that only one subsystem can change (`parity.py`). Each returns a statistic
with its p-value, a sentence and a figure, or why it does not apply.

A row is for the run with the most significant result of its test; the p-value is multiplied by the number of runs. Over
the whole panel, the procedure of Benjamini and Hochberg limits the share of false rows among the significant ones. The
panel shows *that* the model has errors. It names no cause, and no later step uses it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import msgspec
import numpy as np

from diagnosis.contracts import Array
from diagnosis.engine.fitting.fit import FittedModel
from diagnosis.engine.p_values import bonferroni
from diagnosis.engine.residual import over_cycles, over_inputs, over_time
from diagnosis.engine.residual.parity import parities
from diagnosis.engine.residual.residuals import Evidence, NotApplicable, Residuals, residuals_of
from diagnosis.estimates import number
from diagnosis.finding import PanelRow

Test = Callable[[Residuals, int], Evidence | NotApplicable]
TESTS: Final[tuple[tuple[str, str, Test], ...]] = (
    ("size", "error larger than the noise", over_time.size),
    ("memory", "error correlated in time", over_time.memory),
    ("drift", "error drifts over time (without its input part)", over_time.drift),
    ("linear", "error proportional to an input or its rate", over_inputs.follows("linear")),
    ("even", "error has the same sign at low and high input", over_inputs.follows("even")),
    ("odd", "error not linear in an input", over_inputs.follows("odd")),
    ("even harmonics", "error at 2, 4 or 6 times the frequency", over_inputs.rings("even")),
    ("odd harmonics", "error at 3, 5 or 7 times the frequency", over_inputs.rings("odd")),
    ("loss", "energy loss per cycle", over_cycles.loss),
    ("quasi-static", "loop width at two low speeds", over_cycles.quasi_static),
    ("hold", "error changes at constant inputs", over_cycles.settles),
    ("x-v surface", "error depends on motion and speed", over_inputs.velocity_surface),
    ("x-p surface", "error depends on motion and pressure", over_inputs.pressure_surface),
)


def panel(model: FittedModel, *, seed: int = 0, alpha: float = 0.01) -> list[PanelRow]:
    """Return every test on every channel of a fitted model, and on the parity signals of its simulator.

    Each row is for the run with the most significant result; its p-value counts all tested runs. Among the
    ``significant`` rows at most a share ``alpha`` is false, by Benjamini and Hochberg (1995).
    """
    runs = [
        residuals_of(
            run.experiment,
            model.replay.simulator.channels,
            run.outputs,
            predicted,
            block.packing.spread(block.residual),
        )
        for run, predicted, block in zip(
            model.replay.runs, model.predictions, model.linearisation.blocks, strict=True
        )
    ]
    rows = [
        _row(name, title, channel.name, [(run.run, test(run, c)) for run in runs])
        for name, title, test in TESTS
        for c, channel in enumerate(model.replay.simulator.channels)
    ]
    return judged([*rows, *_parities(model, runs, seed)], alpha)


def _parities(model: FittedModel, runs: Sequence[Residuals], seed: int) -> list[PanelRow]:
    source = model.replay.simulator
    found = [(run.run, parities(run, model.noise, source, seed)) for run in runs]
    return [
        _row("parity", "parity", name, [(run, signals[name]) for run, signals in found])
        for name in found[0][1]
    ]


def _row(
    test: str, title: str, channel: str, found: Sequence[tuple[str, Evidence | NotApplicable]]
) -> PanelRow:
    all_evidence = [(run, evidence) for run, evidence in found if isinstance(evidence, Evidence)]
    if not all_evidence:
        why = "; ".join(dict.fromkeys(one.why for _, one in found if isinstance(one, NotApplicable)))
        return PanelRow(
            test=test,
            title=title,
            run="",
            channel=channel,
            statistic=None,
            p=None,
            sentence=f"does not apply: {why}",
            points_to="",
        )
    run, evidence = min(all_evidence, key=lambda one: (one[1].p, -one[1].statistic))
    return PanelRow(
        test=test,
        title=title,
        run=run,
        channel=channel,
        statistic=number(evidence.statistic),
        p=number(bonferroni(evidence.p, len(all_evidence))),
        sentence=evidence.sentence,
        points_to=evidence.points_to,
        figure=evidence.draw() if evidence.draw else None,
    )


def judged(rows: Sequence[PanelRow], alpha: float) -> list[PanelRow]:
    """Return the rows with their q-values. Of each test only the clearest significant row keeps its figure."""
    tested = [i for i, row in enumerate(rows) if row.p is not None]
    q = benjamini_hochberg(np.array([rows[i].p for i in tested], dtype=np.float64))
    result, drawn = list(rows), set()
    # Many a p-value underflows to 0: the statistic then shows which is the clearest.
    for place in sorted(range(len(tested)), key=lambda k: (q[k], -(rows[tested[k]].statistic or 0.0))):
        row = rows[tested[place]]
        significant = bool(q[place] < alpha)
        result[tested[place]] = msgspec.structs.replace(
            row,
            q=number(q[place]),
            significant=significant,
            figure=row.figure if significant and row.test not in drawn else None,
        )
        drawn.add(row.test)
    return result


def benjamini_hochberg(p: Array) -> Array:
    """Return the q-values (m,) of p-values (m,): rejecting all q < α keeps the expected share of false ones below α."""
    order = np.argsort(p)
    stepped = p[order] * p.size / np.arange(1, p.size + 1)
    q = np.empty_like(p)
    q[order] = np.minimum(np.minimum.accumulate(stepped[::-1])[::-1], 1.0)
    return q
