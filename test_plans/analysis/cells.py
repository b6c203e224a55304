"""What the load cells say of the springs: force and moment on the bolster, by where each cell stands and points.

``rig`` gives the dimensions (SI) by their names, as a `description.Description` does.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import numpy as np

from bench_protocol import places
from bench_protocol.dimensions import LOAD_CELLS, direction, place
from drivers.errors import NotAvailable
from test_plans.analysis import Samples
from test_plans.analysis.geometry import Rig, bolster_weight, share_of_spring
from test_plans.analysis.readings import SHEAR_CELLS, VERTICAL_CELLS
from test_plans.description import once_for_a_rig

#: Where the upright cells stand, and which way they point.
CELLS: Final = (
    *(name for cell in VERTICAL_CELLS for name in (*place(cell), *direction(cell))),
    "spring_half_spacing",
    "column_height",
)
#: Which way the cells across point, and where they stand.
CELLS_ACROSS: Final = (
    *(name for cell in SHEAR_CELLS for name in (*place(cell), *direction(cell))),
    "column_height",
)


column_of = once_for_a_rig(places.column_of)
pointing = once_for_a_rig(places.pointing)


@once_for_a_rig
def rolling(rig: Rig, cell: str) -> float:
    """Return the roll moment (m) of one newton on a ``cell``; of a height that does not matter nothing is asked."""
    _, d_y, d_z = pointing(rig, cell)
    _, across, up = place(cell)
    return rig[across] * d_z - ((rig[up] - rig["column_height"]) * d_y if d_y else 0.0)


#: The six parts of a wrench, as people call them, in the order of `column_of`.
PARTS: Final = (
    "force ahead",
    "force sideways",
    "force upward",
    "roll moment",
    "pitch moment",
    "yaw moment",
)
#: What is less is rounding; and what is less is no more than a cell that was not set up exactly.
NOTHING: Final = 1e-9
SOME: Final = 0.05


def wrench(values: Mapping[str, Any], rig: Rig) -> tuple[Samples, ...]:
    """Return the six `PARTS` of what springs and bump stop do to the bolster (N, N·m), by all cells in ``values``."""
    columns = {cell: column_of(rig, cell) for cell in cells_in(values)}
    return tuple(
        np.asarray(sum(column[part] * np.asarray(values[cell]) for cell, column in columns.items()))
        for part in range(len(PARTS))
    )


def unseen(rig: Rig, cells: Iterable[str] | None = None) -> tuple[str, ...]:
    """Return which `PARTS` of a wrench these ``cells``, or all that are described, do not tell, whatever they read.

    Something else bears those, a guide or the cells' own stiffness across: Aᵀn = 0 for a wrench n of that part.
    """
    columns = [column_of(rig, cell) for cell in (described(rig) if cells is None else cells)]
    if not columns:
        return PARTS
    a = np.array(columns)
    _, sizes, ways = np.linalg.svd(a)
    blind = ways[int(np.sum(sizes > NOTHING * sizes[0])) :]
    return tuple(part for part, along in zip(PARTS, blind.T, strict=True) if np.linalg.norm(along) > 1e-6)


def ahead_of(values: Mapping[str, Any], rig: Rig, force: str) -> tuple[Samples, Samples]:
    """Return a force on the bolster, upward or sideways, and its moment (N·m) for standing ahead of the middle.

    Their ratio is how far ahead it acts: M_y = −x F_z and M_z = x F_y.
    """
    told = dict(zip(PARTS, wrench(values, rig), strict=True))
    moment = -told["pitch moment"] if force == "force upward" else told["yaw moment"]
    return told[force], moment


def against_each_other(values: Mapping[str, Any], rig: Rig) -> dict[str, Samples]:
    """Return what each cell in ``values`` bears (N) that no force on the bolster asks for: An = 0 for such readings n.

    Four upright cells bear a twist so: by a support that gives way, or stands out of the plane of the others.
    """
    there = cells_in(values)
    columns = np.array([column_of(rig, cell) for cell in there]).T
    _, sizes, ways = np.linalg.svd(columns)
    kernel = ways[int(np.sum(sizes > NOTHING * sizes[0])) :]
    read = np.array([np.asarray(values[cell], float) for cell in there])
    return dict(zip(there, kernel.T @ (kernel @ read), strict=True))


def cells_in(values: Mapping[str, object]) -> tuple[str, ...]:
    """Return the load cells of which there are ``values``, without looking at these."""
    there = frozenset(values)
    return tuple(cell for cell in LOAD_CELLS if cell in there)


@once_for_a_rig
def described(rig: Rig) -> tuple[str, ...]:
    """Return the load cells of which somebody has stated where they stand and which way they point."""
    return tuple(cell for cell in LOAD_CELLS if _is_described(rig, cell))


def _is_described(rig: Rig, cell: str) -> bool:
    return all(name in rig for name in (*place(cell), *direction(cell)))


@once_for_a_rig
def bearing(rig: Rig, least: float = NOTHING) -> tuple[str, ...]:
    """Return the load cells that an upright force loads, by ``least`` of it or more: what has to be read.

    The upright ones, where nobody says which way they point.
    """
    return _pointing(rig, 2, least) or VERTICAL_CELLS


@once_for_a_rig
def guiding(rig: Rig, least: float = NOTHING) -> tuple[str, ...]:
    """Return the load cells that a force sideways loads: those across, where nobody says which way they point."""
    return _pointing(rig, 1, least) or SHEAR_CELLS


#: Which cells a motion along an axis loads.
LOADED: Final = {"vertical": bearing, "lateral": guiding}


def _pointing(rig: Rig, way: int, least: float) -> tuple[str, ...]:
    known = (cell for cell in LOAD_CELLS if direction(cell)[way] in rig)
    return tuple(cell for cell in known if abs(pointing(rig, cell)[way]) > least)


def upward_force(values: Mapping[str, Any], rig: Rig) -> Samples:
    """Return what springs and bump stop press the bolster up with (N), by all cells in ``values``."""
    return _sum(rig, values, lambda cell: pointing(rig, cell)[2], bearing(rig, SOME))


def sideways_force(values: Mapping[str, Any], rig: Rig) -> Samples:
    """Return what springs and bump stop push the bolster to the left with (N), by all cells in ``values``."""
    return _sum(rig, values, lambda cell: pointing(rig, cell)[1], guiding(rig, SOME))


def cell_moment(values: Mapping[str, Any], rig: Rig) -> Samples:
    """Return the moment against the roll (N·m), by all cells in ``values``."""
    return -_sum(rig, values, lambda cell: rolling(rig, cell), bearing(rig, SOME))


def _sum(
    rig: Rig, values: Mapping[str, Any], share: Callable[[str], float], needed: tuple[str, ...]
) -> Samples:
    """Return the sum of all cells in ``values``, each by its ``share``; what has none is not looked at.

    NotAvailable if one that is ``needed`` is not among them, or nobody has said how it stands: the rest would be too
    little.
    """
    there = cells_in(values)
    if lacking := [cell for cell in needed if cell not in there]:
        raise NotAvailable(f"without {', '.join(lacking)} nobody knows what the load cells bear together")
    known = described(rig)
    shares = {cell: share(cell) for cell in there if cell in needed or cell in known}
    return np.asarray(sum(one * np.asarray(values[cell]) for cell, one in shares.items() if one))


@once_for_a_rig
def _share_of_cell(rig: Rig, side: str, cell: str) -> float:
    return share_of_spring(rig, side, pointing(rig, cell)[2], rolling(rig, cell))


@once_for_a_rig
def cells_under(rig: Rig, side: str) -> tuple[str, ...]:
    """Return the load cells that tell the load on one spring: where they stand below the springs, its own.

    All of them, where nobody knows which stands where. What a cell says by its place being uncertain does not count.
    """
    if any(name not in rig for name in CELLS):
        return VERTICAL_CELLS
    return tuple(cell for cell in bearing(rig, SOME) if abs(_share_of_cell(rig, side, cell)) > SOME)


def load_on(values: Mapping[str, Any], rig: Rig, side: str) -> Samples:
    """Return the force on one spring (N, downward), by all cells in ``values``."""
    return _sum(rig, values, lambda cell: _share_of_cell(rig, side, cell), cells_under(rig, side))


def rest_load(rig: Rig, cell: str) -> float:
    """Return what a cell reads (N) of the bolster alone: of equal cells that bear it without any moment."""
    cells = bearing(rig, SOME)
    columns = np.array([column_of(rig, one) for one in cells])
    upward = np.array([part == "force upward" for part in PARTS], float)
    carried = np.linalg.lstsq(columns.T, upward, rcond=None)[0]
    return bolster_weight(rig) * float(carried[cells.index(cell)])
