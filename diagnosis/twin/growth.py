"""Causes that grow: replays of the growth, each corrected by the error of the replay before.

The sum of steps (`forms.growing`) shows roughly when a cause grew, and to which size. A replay of this growth gives the
exact effect, also where it is not linear in the size. The difference between the replay and the steps is added to the
steps, for all similar growths. The corrected steps then give a better growth for the next replay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from diagnosis.contracts import Array, Hypothesis
from diagnosis.twin.forms import (
    DeviatingStretch,
    Form,
    Forms,
    Shaped,
    SizedCause,
    left_by,
    places,
    share_grown,
    suspect,
)
from diagnosis.twin.pairs import Acting
from diagnosis.twin.replays import Secant, bounded, can_be, typical
from diagnosis.twin.slices import Work

#: Number of replays of one growth.
_ROUNDS: Final = 10
#: It is found when the next one would be so near, as a share of its size.
_SAME: Final = 1e-3
#: Size of the steps of an earlier cause, in ordinary sizes: it may have grown since.
_LARGER: Final = 5.0


class Growing(NamedTuple):
    """A growing cause: its possible time courses, and the best of them, computed as a sum of steps."""

    cause: Hypothesis
    shapes: Mapping[str, float]
    forms: Forms
    best: Shaped


class Growth:
    """The search for causes that grow, in a stretch that deviates since bin ``since``."""

    def __init__(self, stretch: DeviatingStretch, since: int) -> None:
        self._stretch, self._since = stretch, since
        self._bins = len(stretch.columns.measured)
        self._tried: set[str] = set()

    def explains(self, one: Growing) -> Work[SizedCause | None]:
        """Replay a growing cause and refine it. Return the cause if it explains the stretch; otherwise None."""
        cause, shapes, forms, shaped = one
        self._tried.add(cause.name)
        secant, size = Secant(), shaped.fit.size
        middles = np.asarray(np.arange(self._bins) + 0.5)
        replayed, alike = list[Shaped](), [shaped]
        for _ in range(_ROUNDS):
            size = bounded(cause, size)
            begins, ends = shaped.begins, shaped.ends
            added = self._stretch.replays.changing(cause, shapes, size * share_grown(middles, begins, ends))
            yield
            if added is None:
                break
            replayed.append(forms.grown(begins, ends, size, added))
            shaped, alike = forms.best(Form.GROWING, [replayed[-1]])
            yield
            near = abs(shaped.fit.size - size) < _SAME * abs(size)
            if near and (shaped.begins, shaped.ends) == (begins, ends):
                break
            size = secant.after(size, shaped.fit.size)
        if not replayed:
            return None
        best = min(replayed, key=left_by)
        along = self._stretch.agrees(best.fit.size * best.column, best.fit.left)
        if not along or not can_be(cause, best.fit.size):
            return None
        return suspect(cause.name, Form.GROWING, best, [best, *alike], self._bins)

    def among(self, causes: Sequence[Acting]) -> Work[list[SizedCause]]:
        """Return the growing causes that explain the stretch. The candidates are ``causes`` and those easily confused
        with them.
        """
        found: list[SizedCause] = []
        asked = list(causes)
        for acting in asked:
            if acting.cause.name in self._tried:
                continue
            self._tried.add(acting.cause.name)
            growing = yield from self._growing(acting)
            one = (yield from self.explains(growing)) if growing else None
            if one is not None:
                found.append(one)
                asked += self.mistaken_for(one)  # which are tried next
        return found

    def mistaken_for(self, one: SizedCause) -> list[Acting]:
        """Return the causes that are easily confused with a cause that explains the stretch, with typical sizes."""
        confusers = next(cause.confusers for cause, _ in self._stretch.points if cause.name == one.name)
        return [
            Acting(cause, shapes, typical(cause), 0)
            for cause, shapes in self._stretch.points
            if cause.name.partition(".")[0] in confusers
        ]

    def _growing(self, acting: Acting) -> Work[Growing | None]:
        """Return the growth of an earlier cause as a sum of steps; None if its simulation fails."""
        cause, shapes, size, _ = acting
        asked = (cause, shapes, bounded(cause, float(np.copysign(_LARGER * typical(cause), size))))
        steps: dict[int, Array] = {}
        for place in places(self._since, self._bins):
            (column,) = self._stretch.replays.columns([asked], place)
            yield
            if column is not None:
                steps[place] = column
        forms = Forms(self._stretch.fit, cause, self._bins, steps, lambda _: {})
        some = forms.coarse(Form.GROWING)
        yield
        return Growing(cause, shapes, forms, forms.best(Form.GROWING, some)[0]) if some else None
