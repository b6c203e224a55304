"""Forces and moments on the bolster, computed from the load cells with their positions and directions.

``rig`` maps the names of dimensions to their values (SI), as a `description.Description` does. A *wrench* is a force
with its moment.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import numpy as np

from bench_protocol import geometry
from bench_protocol.dimensions import LOAD_CELLS, direction, place
from drivers.errors import NotAvailable
from test_plans.analysis import SHEAR_CELLS, VERTICAL_CELLS, Samples
from test_plans.analysis.geometry import Rig, bolster_weight, share_of_spring
from test_plans.description import once_for_a_rig

#: Dimensions of the upright cells: positions and directions.
CELLS: Final = (
    *(name for cell in VERTICAL_CELLS for name in (*place(cell), *direction(cell))),
    "spring_half_spacing",
    "column_height",
)
#: Dimensions of the cells across: positions and directions.
CELLS_ACROSS: Final = (
    *(name for cell in SHEAR_CELLS for name in (*place(cell), *direction(cell))),
    "column_height",
)


column_of = once_for_a_rig(geometry.column_of)
pointing = once_for_a_rig(geometry.pointing)


@once_for_a_rig
def rolling(rig: Rig, cell: str) -> float:
    """Return the roll moment that a ``cell`` exerts per unit of its force (m). The height of the cell is read only if
    it matters.
    """
    _, d_y, d_z = pointing(rig, cell)
    _, across, up = place(cell)
    return rig[across] * d_z - ((rig[up] - rig["column_height"]) * d_y if d_y else 0.0)


#: Names of the six components of a wrench, in the order of `column_of`.
PARTS: Final = (
    "force ahead",
    "force sideways",
    "force upward",
    "roll moment",
    "pitch moment",
    "yaw moment",
)
#: Smaller shares are rounding errors (NOTHING), or an inexact alignment of a cell (SOME).
NOTHING: Final = 1e-9
SOME: Final = 0.05


def wrench(values: Mapping[str, Any], rig: Rig) -> tuple[Samples, ...]:
    """Return the `PARTS` of the wrench that springs and bump stop exert on the bolster (N, N·m), from the cells in
    ``values``.
    """
    columns = {cell: column_of(rig, cell) for cell in cells_in(values)}
    return tuple(
        np.asarray(sum(column[part] * np.asarray(values[cell]) for cell, column in columns.items()))
        for part in range(len(PARTS))
    )


def unseen(rig: Rig, cells: Iterable[str] | None = None) -> tuple[str, ...]:
    """Return the `PARTS` of a wrench that these ``cells`` (default: all described cells) cannot measure.

    A guide, or the transverse stiffness of the cells, carries these parts: Aᵀn = 0 for a wrench n of that part.
    """
    columns = [column_of(rig, cell) for cell in (described(rig) if cells is None else cells)]
    if not columns:
        return PARTS
    a = np.array(columns)
    _, sizes, ways = np.linalg.svd(a)
    blind = ways[int(np.sum(sizes > NOTHING * sizes[0])) :]
    return tuple(part for part, along in zip(PARTS, blind.T, strict=True) if np.linalg.norm(along) > 1e-6)


def ahead_of(values: Mapping[str, Any], rig: Rig, force: str) -> tuple[Samples, Samples]:
    """Return a force on the bolster (N), upward or sideways, and the moment (N·m) that its longitudinal position
    causes.

    Their ratio gives this position x: M_y = −x F_z and M_z = x F_y.
    """
    parts = dict(zip(PARTS, wrench(values, rig), strict=True))
    moment = -parts["pitch moment"] if force == "force upward" else parts["yaw moment"]
    return parts[force], moment


def against_each_other(values: Mapping[str, Any], rig: Rig) -> dict[str, Samples]:
    """Return the part of each reading in ``values`` (N) that gives no resultant force or moment: An = 0 for such
    readings n.

    With four upright cells this part is a twist. It occurs if one support yields, or if it is not in the plane of the
    others.
    """
    there = cells_in(values)
    columns = np.array([column_of(rig, cell) for cell in there]).T
    _, sizes, ways = np.linalg.svd(columns)
    kernel = ways[int(np.sum(sizes > NOTHING * sizes[0])) :]
    read = np.array([np.asarray(values[cell], float) for cell in there])
    return dict(zip(there, kernel.T @ (kernel @ read), strict=True))


def cells_in(values: Mapping[str, object]) -> tuple[str, ...]:
    """Return the load cells with an entry in ``values``; the entries themselves are not used."""
    there = frozenset(values)
    return tuple(cell for cell in LOAD_CELLS if cell in there)


@once_for_a_rig
def described(rig: Rig) -> tuple[str, ...]:
    """Return the load cells with a stated position and direction."""
    return tuple(cell for cell in LOAD_CELLS if _is_described(rig, cell))


def _is_described(rig: Rig, cell: str) -> bool:
    return all(name in rig for name in (*place(cell), *direction(cell)))


@once_for_a_rig
def bearing(rig: Rig, least: float = NOTHING) -> tuple[str, ...]:
    """Return the load cells that carry more than the share ``least`` of an upright force.

    Without stated directions these are the upright cells.
    """
    return _pointing(rig, 2, least) or VERTICAL_CELLS


@once_for_a_rig
def guiding(rig: Rig, least: float = NOTHING) -> tuple[str, ...]:
    """Return the load cells that carry more than the share ``least`` of a lateral force.

    Without stated directions these are the lateral cells.
    """
    return _pointing(rig, 1, least) or SHEAR_CELLS


#: Cells that a motion along an axis loads.
LOADED: Final = {"vertical": bearing, "lateral": guiding}


def _pointing(rig: Rig, way: int, least: float) -> tuple[str, ...]:
    known = (cell for cell in LOAD_CELLS if direction(cell)[way] in rig)
    return tuple(cell for cell in known if abs(pointing(rig, cell)[way]) > least)


def upward_force(values: Mapping[str, Any], rig: Rig) -> Samples:
    """Return the upward force of springs and bump stop on the bolster (N), from all cells in ``values``."""
    return _sum(rig, values, lambda cell: pointing(rig, cell)[2], bearing(rig, SOME))


def sideways_force(values: Mapping[str, Any], rig: Rig) -> Samples:
    """Return the force of springs and bump stop on the bolster to the left (N), from all cells in ``values``."""
    return _sum(rig, values, lambda cell: pointing(rig, cell)[1], guiding(rig, SOME))


def cell_moment(values: Mapping[str, Any], rig: Rig) -> Samples:
    """Return the moment of springs and bump stop that opposes the roll (N·m), from all cells in ``values``."""
    return -_sum(rig, values, lambda cell: rolling(rig, cell), bearing(rig, SOME))


def _sum(
    rig: Rig, values: Mapping[str, Any], share: Callable[[str], float], needed: tuple[str, ...]
) -> Samples:
    """Return the sum of all cells in ``values``, each weighted by its ``share``. Cells with the share 0 are not read.

    Raises NotAvailable if a ``needed`` cell has no value or no stated position, because the sum would be incomplete.
    """
    there = cells_in(values)
    if lacking := [cell for cell in needed if cell not in there]:
        raise NotAvailable(
            f"without {', '.join(lacking)} the sum of the load cells is unknown; connect and describe them"
        )
    known = described(rig)
    shares = {cell: share(cell) for cell in there if cell in needed or cell in known}
    return np.asarray(sum(one * np.asarray(values[cell]) for cell, one in shares.items() if one))


@once_for_a_rig
def _share_of_cell(rig: Rig, side: str, cell: str) -> float:
    return share_of_spring(rig, side, pointing(rig, cell)[2], rolling(rig, cell))


@once_for_a_rig
def cells_under(rig: Rig, side: str) -> tuple[str, ...]:
    """Return the load cells that measure the load on one spring. Cells directly below the other spring are not
    included.

    Without stated positions these are all upright cells. Shares up to `SOME` do not count, because positions are
    inexact.
    """
    if any(name not in rig for name in CELLS):
        return VERTICAL_CELLS
    return tuple(cell for cell in bearing(rig, SOME) if abs(_share_of_cell(rig, side, cell)) > SOME)


def load_on(values: Mapping[str, Any], rig: Rig, side: str) -> Samples:
    """Return the force on one spring (N, downward), from all cells in ``values``."""
    return _sum(rig, values, lambda cell: _share_of_cell(rig, side, cell), cells_under(rig, side))


def rest_load(rig: Rig, cell: str) -> float:
    """Return the reading of a cell (N) under the bolster alone, if the cells are equal and carry it without moment."""
    cells = bearing(rig, SOME)
    columns = np.array([column_of(rig, one) for one in cells])
    upward = np.array([part == "force upward" for part in PARTS], float)
    carried = np.linalg.lstsq(columns.T, upward, rcond=None)[0]
    return bolster_weight(rig) * float(carried[cells.index(cell)])
