"""Checks of the load cells: crosstalk, position of the force, and internal forces between the cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.units import mm
from test_plans.analysis import VERTICAL_CELLS, Samples, straight_line
from test_plans.analysis.cells import against_each_other, ahead_of, described, upward_force
from test_plans.check_names import CheckName
from test_plans.loads import Band
from test_plans.steps.shaking import check_band

if TYPE_CHECKING:
    from test_plans.analysis.geometry import Rig
    from test_plans.run import Run

ACROSS: Final = CheckName(
    "{cell} over vertical force",
    "The reading of a lateral cell under a vertical force: with every load change, it looks like a lateral force.",
)
AHEAD: Final = {
    "force upward": CheckName(
        "force upward, ahead of the middle",
        "Distance of the springs' force ahead of the middle, from all cells: a displaced seat loads the front and rear "
        "cells unequally, and tilts the platform.",
    ),
    "force sideways": CheckName(
        "force sideways, ahead of the middle",
        "Distance of the lateral force ahead of the middle, from all cells: a displaced actuator or seat "
        "turns the bolster.",
    ),
}
AGAINST: Final = CheckName(
    "what the cells bear against each other",
    "The largest load of a cell that no external force causes, over the load: the support of a cell yields.",
)
#: Largest reading of a lateral cell, relative to a vertical force.
CROSSTALK: Final = Band(-0.002, 0.002)
#: Longitudinal tolerance of seats and actuators.
CENTRED: Final = 5 * mm
#: Larger tolerance laterally, because the forces are small.
AHEAD_WITHIN: Final = {"force upward": Band(-CENTRED, CENTRED), "force sideways": Band(-10 * mm, 10 * mm)}
#: Relative to the load: three times the result of the errors of four cells.
TOGETHER: Final = Band(high=0.005)

#: Means by signal, step by step.
Steps = Sequence[Mapping[str, float]]


def check_across(run: Run, cells: Sequence[str], read: Steps, *, over: float) -> None:
    """Check how much each of the lateral ``cells`` reads under an upward force (crosstalk). Each step was averaged for
    ``over`` s.
    """
    for cell in cells:
        name = ACROSS.of(cell=cell)
        if run.can(name, needs=(cell,)):
            felt = run.measured(partial(_crosstalk, cell), *read, over=over, themselves=True)
            check_band(run, name, felt, "%", CROSSTALK)


def check_ahead(run: Run, force: str, read: Steps, *, over: float) -> None:
    """Check the longitudinal position of a ``force`` that changed from step to step. Each step was averaged for
    ``over`` s.
    """

    def ahead(rig: Rig, *means: Mapping[str, float]) -> float:
        return straight_line(*ahead_of(_of_cells(rig, means), rig, force))[1]

    found = run.measured(ahead, run.rig, *read, over=over, themselves=True)
    check_band(run, AHEAD[force], found, "mm", AHEAD_WITHIN[force])


def check_against(run: Run, read: Steps, *, over: float) -> None:
    """Check the internal force between the cells per unit of upward force. Each step was averaged for ``over`` s."""

    def most(rig: Rig, *means: Mapping[str, float]) -> float:
        values = _of_cells(rig, means)
        upward = upward_force(values, rig)
        return max(abs(straight_line(upward, one)[1]) for one in against_each_other(values, rig).values())

    found = run.measured(most, run.rig, *read, over=over, themselves=True)
    check_band(run, AGAINST, found, "%", TOGETHER)


def _of_cells(rig: Rig, read: Steps) -> dict[str, Samples]:
    """Return by cell the readings of all steps, for the cells with a stated position and direction."""
    known = [cell for cell in described(rig) if cell in read[0]]
    return {cell: np.array([one[cell] for one in read]) for cell in known}


def _crosstalk(cell: str, *read: Mapping[str, float]) -> float:
    upward = np.array([sum(one[upright] for upright in VERTICAL_CELLS) for one in read])
    return straight_line(upward, np.array([one[cell] for one in read]))[1]
