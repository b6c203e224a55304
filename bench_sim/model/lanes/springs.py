"""Integrates springs between plates with a given motion, eight at the same time.

Theory of operation
-------------------
In a replay the left and the right spring are independent except for the readings (`bench_sim.model.replay`), unless air
flows between them. So each spring is one lane, of any side, run or parameter set. Its trajectory is a `TRACE`. Every
reading follows from the trace, the motion and the parameters (`bench_sim.model.lanes.traces`). If air flows between the
springs, both springs of a bench are integrated together (`bench_sim.model.lanes.valves`), four benches at a time.

The method, its step and the actions once per step are those of the scalar replay (`bench_sim.model.runge_kutta`,
`bench_sim.model.step_start`). Tests compare both. Pressures agree to a thousandth of a pascal, the tolerance of
Newton's method in the scalar replay. Friction is switched lane by lane, by the same function.

The stiffness of a spring is estimated from the second and the third stage of a step, which are at one instant. The
difference of their slopes is the Jacobian times half a step times the difference of the slopes of the first two stages.
So h |λ| is twice the ratio of both differences (Hairer and Wanner, Solving Ordinary Differential Equations II, section
IV.2). The sums over a run weight the moving parts of the spring. A bench has h |λ| = 0.1 at a step of 2.5 ms.
"""

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench_sim.model.compiled import compiled, compiled_parallel
from bench_sim.model.gas import has_moved, keep_density
from bench_sim.model.lanes.layout import (
    EXTRA_FRICTION,
    EXTRA_LEVEL_Y,
    EXTRA_LEVEL_Z,
    EXTRA_RATIO,
    LANE_FRICTIONS,
    LANES,
    LENGTH,
    PAIRS,
    PER_LANE,
    SLOPE,
    STAGE,
    START,
    SUM,
    Lane,
    LaneState,
)
from bench_sim.model.lanes.slope import ActiveTerms, lane_slope
from bench_sim.model.lanes.valves import (
    gather_valves,
    settle_levers,
    switch_between,
    switch_leveling_valves,
)
from bench_sim.model.layout import EXTRA_BRANCHES, STATES, TINY
from bench_sim.model.quantities import MEMORY, PARAMETERS, Lanes, in_lanes
from bench_sim.model.replay import STEP
from bench_sim.model.rest import relax_rubber
from bench_sim.model.rubber import turn_friction

#: Largest h |λ| at which a step longer than that of a replay is accurate enough. The stability limit is 2.8.
STIFFEST: Final = 1.0
#: Columns of a trace: pressure and temperature of bellows and auxiliary chamber, force of bellows and emergency
#: spring (vertical, lateral), compression of the contact. Its rows are the beginnings of the steps.
TRACE: Final = 7
AUXILIARY_PRESSURE: Final = 2
#: Parameters that the integration reads in addition to the column of a spring.
SURFACES: Final = in_lanes(Lanes.SURFACE)
FEEDING: Final = in_lanes(Lanes.FEEDS)
JOINING: Final = in_lanes(Lanes.JOINS)


class Course(NamedTuple):
    """The motion of the plates of one spring, and its valves. An interval of the recorded motion has
    ``steps`` steps.
    """

    step: float  #: s
    places: NDArray[np.float64]  #: (2 rows − 1, 4) every half step: ζ and its speed, y and its speed
    valves: NDArray[np.float64]  #: (rows, GIVEN) values during each step, from `Lane.OPENING` on
    fed: bool  #: whether air enters or leaves the springs at any time


@dataclass(frozen=True, slots=True, eq=False)
class LaneSpring:
    """One spring to be integrated: its column (`bench_sim.model.lanes.start`), parameter record, side and course.

    Its plate is ``shift`` m to the left of that of the course. Its supply pressure is ``supply_error`` Pa below that of
    the course.
    """

    column: NDArray[np.float64]
    parameters: Any
    side: int
    course: Course
    shift: float
    supply_error: float = 0.0

    @property
    def key(self) -> Hashable:
        """Return a key that is equal for springs with the same trajectory. It contains the ``id`` of the ``course``, so
        it is valid only while this object exists.
        """
        beside = (*(SURFACES if self.surfaced else ()), *(FEEDING if self.course.fed else ()))
        return id(self.course), self.shift, self.supply_error, self.column.tobytes(), self.all_of(beside)

    def all_of(self, names: Iterable[str]) -> bytes:
        """Return the bytes of the named parameters, for comparison."""
        return b"".join(self.parameters[name].tobytes() for name in names)

    @property
    def surfaced(self) -> bool:
        """Whether any fitted surface (unknown flow or heat) is active."""
        return any(bool(self.parameters[name].any()) for name in ("flow_surface", "heat_surface"))


def key_of(springs: Sequence[LaneSpring]) -> Hashable:
    """Return the key of springs that are integrated together: one spring, or both springs with a valve between them."""
    own = tuple(spring.key for spring in springs)
    return own if len(springs) == 1 else (*own, springs[0].all_of(JOINING))


@compiled
def gather(w: Any, at: int, courses: Any, rows: Any) -> None:
    """Set the plates of all lanes to their position at half step ``at``. A lane whose course has ended
    stays at rest.
    """
    for i in range(LANES):
        places = courses[i]
        last = 2 * (rows[i] - 1)
        k = min(at, last)
        going = 1.0 if at <= last else 0.0
        w[Lane.HEIGHT + i] = places[k, 0]
        w[Lane.HEIGHT_SPEED + i] = going * places[k, 1]
        w[Lane.LATERAL + i] = places[k, 2] + w[Lane.SHIFT + i]
        w[Lane.LATERAL_SPEED + i] = going * places[k, 3]


@compiled
def note_friction(w: Any, i: int, side: int, mem: Any) -> None:
    """Copy the reversal points of the friction from the memory of one lane to ``w``."""
    w[Lane.ORIGIN_Z + i] = mem.friction_origin[0, side]
    w[Lane.LEVEL_Z + i] = mem.friction_level[0, side]
    w[Lane.ORIGIN_Y + i] = mem.friction_origin[1, side]
    w[Lane.LEVEL_Y + i] = mem.friction_level[1, side]
    for e in range(LANE_FRICTIONS):
        w[EXTRA_LEVEL_Z + LANES * e + i] = mem.extra_friction_level[e, 0, side]
        w[EXTRA_LEVEL_Y + LANES * e + i] = mem.extra_friction_level[e, 1, side]


@compiled
def note_motion(w: Any, sides: Any, memory: Any, parameters: Any, dt: float, turned: Any) -> bool:
    """Update the friction like `bench_sim.model.step_start.note_solution`. Write to ``turned`` in which lanes it has
    reversed, and return whether it has in any.
    """
    found = False
    for i in range(LANES):
        side = sides[i]
        mem = memory[i]
        par = parameters[i]
        z, z_speed = w[Lane.BELLOWS_Z + i], w[Lane.BELLOWS_Z_SPEED + i]
        y, y_speed = w[Lane.BELLOWS_Y + i], w[Lane.BELLOWS_Y_SPEED + i]
        travel_z, travel_y = par.friction_vertical_travel[side], par.friction_lateral_travel[side]
        one = turn_friction(mem, par, 0, side, z, z_speed, w[Lane.NOTED_Z_SPEED + i], travel_z, dt)
        other = turn_friction(mem, par, 1, side, y, y_speed, w[Lane.NOTED_Y_SPEED + i], travel_y, dt)
        turned[i] = one or other
        if turned[i]:
            note_friction(w, i, side, mem)
            found = True
        w[Lane.NOTED_Z + i], w[Lane.NOTED_Z_SPEED + i] = z, z_speed
        w[Lane.NOTED_Y + i], w[Lane.NOTED_Y_SPEED + i] = y, y_speed
    return found


@compiled
def restore(w: Any, saved: Any, turned: Any) -> None:
    """Restore the saved values of the lanes whose friction has not ``turned``."""
    for i in range(LANES):
        if not turned[i]:
            for k in range(i, LENGTH, LANES):
                w[k] = saved[k]


@compiled
def note_flow(w: Any) -> None:
    """Store the steady and the missing flow of all lanes, like `bench_sim.model.valves.note_flows`."""
    for i in range(LANES):
        w[Lane.NOTED_STEADY_FLOW + i] = w[Lane.STEADY_FLOW + i]
        w[Lane.NOTED_MISSING_FLOW + i] = w[Lane.STEADY_FLOW + i] - w[Lane.FLOW + i]


@compiled
def note_gas(w: Any, sides: Any, memory: Any, parameters: Any) -> None:
    """Store the densities and their factors like `bench_sim.model.gas.note_densities`."""
    lanes = w.shape[0] // PER_LANE
    far = 0
    for i in range(lanes):
        density = w[STAGE + LaneState.MASS + i] / w[Lane.VOLUME + i]
        auxiliary = w[STAGE + LaneState.AUXILIARY_MASS + i] / w[Lane.AUXILIARY_VOLUME + i]
        w[Lane.PRESENT_DENSITY + i] = density
        w[Lane.AUXILIARY_PRESENT_DENSITY + i] = auxiliary
        far += 1 if has_moved(density, w[Lane.DENSITY + i]) else 0
        far += 1 if has_moved(auxiliary, w[Lane.AUXILIARY_DENSITY + i]) else 0
    if far == 0:
        return
    for i in range(LANES):
        side = sides[i]
        mem = memory[i]
        keep_density(mem, parameters[i], side, w[Lane.PRESENT_DENSITY + i])
        keep_density(mem, parameters[i], 2 + side, w[Lane.AUXILIARY_PRESENT_DENSITY + i])
        w[Lane.DENSITY + i] = mem.heat_density[side]
        w[Lane.DENSITY_FACTOR + i] = mem.heat_factor[side]
        w[Lane.AUXILIARY_DENSITY + i] = mem.heat_density[2 + side]
        w[Lane.AUXILIARY_DENSITY_FACTOR + i] = mem.heat_factor[2 + side]


@compiled
def note_trace(w: Any, n: int, traces: Any) -> None:
    """Write row n of the traces of all lanes."""
    for i in range(LANES):
        traces[i, n, 0] = w[Lane.PRESSURE + i]
        traces[i, n, 1] = w[Lane.TEMPERATURE + i]
        traces[i, n, 2] = w[Lane.AUXILIARY_PRESSURE + i]
        traces[i, n, 3] = w[Lane.AUXILIARY_TEMPERATURE + i]
        traces[i, n, 4] = w[Lane.STACK_Z + i]
        traces[i, n, 5] = w[Lane.STACK_Y + i]
        traces[i, n, 6] = w[Lane.CONTACT + i]


@compiled
def recall(w: Any, sides: Any, memory: Any, scratch: Any) -> None:
    """Fill the memory records of all lanes from their columns in ``w``."""
    for i in range(LANES):
        side = sides[i]
        mem = memory[i]
        relax_rubber(scratch, mem, side, w[Lane.NOTED_Z + i], w[Lane.NOTED_Y + i])
        mem.friction_origin[0, side] = w[Lane.ORIGIN_Z + i]
        mem.friction_origin[1, side] = w[Lane.ORIGIN_Y + i]
        mem.heat_density[side] = w[Lane.DENSITY + i]
        mem.heat_factor[side] = w[Lane.DENSITY_FACTOR + i]
        mem.heat_density[2 + side] = w[Lane.AUXILIARY_DENSITY + i]
        mem.heat_factor[2 + side] = w[Lane.AUXILIARY_DENSITY_FACTOR + i]


@compiled
def most(w: Any, row: int, count: int) -> int:
    """Count in each lane the rows from ``row`` on until the first zero, at most ``count``. Return the largest
    number.
    """
    used = 0
    for i in range(LANES):
        own = 0
        while own < count and w[row + LANES * own + i] != 0.0:
            own += 1
        used = max(used, own)
    return used


@compiled
def active_terms(w: Any, surfaces: bool, fed: bool, joined: bool) -> ActiveTerms:
    """Return which terms are active in at least one lane."""
    extra = most(w, EXTRA_RATIO, EXTRA_BRANCHES)
    frictions = most(w, EXTRA_FRICTION, LANE_FRICTIONS)
    inert = most(w, Lane.INERTANCE, 1) > 0
    leaking = most(w, Lane.LEAK, 1) > 0 or most(w, Lane.LEAK_LAMINAR, 1) > 0
    return ActiveTerms(extra, frictions, inert, leaking, surfaces, fed, joined)


@compiled
def move_valves(
    w: Any, n: int, active: ActiveTerms, valves: Any, rows: Any, sides: Any, memory: Any, parameters: Any
) -> None:
    """Set all valves at the start of step ``n``."""
    gather_valves(w, n, valves, rows, active.fed or active.joined)
    if active.fed:
        switch_leveling_valves(w, sides, memory, parameters)
    if active.joined:
        switch_between(w, memory, parameters)


@compiled
def stage(w: Any, size: int, weight: float, ahead: float) -> None:
    """Add the slopes of the first ``size`` states times ``weight`` to the sum. Set these states to those ``ahead`` s
    after the start of the step.
    """
    for k in range(size):
        w[SUM + k] += weight * w[SLOPE + k]
        w[STAGE + k] = w[START + k] + ahead * w[SLOPE + k]


@compiled
def finish(w: Any, size: int, h: float) -> None:
    """End a step of ``h`` s. Store the curvature of the bellows' motion, from which later steps are predicted."""
    for i in range(LANES):
        z = (w[Lane.BELLOWS_Z + i] - w[Lane.NOTED_Z + i]) / h
        y = (w[Lane.BELLOWS_Y + i] - w[Lane.NOTED_Y + i]) / h
        w[Lane.BEND_Z + i] = (z - w[Lane.NOTED_Z_SPEED + i]) / h
        w[Lane.BEND_Y + i] = (y - w[Lane.NOTED_Y_SPEED + i]) / h
    for k in range(size):
        new = w[START + k] + h / 6.0 * (w[SUM + k] + w[SLOPE + k])
        new = new if abs(new) > TINY else 0.0
        w[START + k] = new
        w[STAGE + k] = new
        w[SUM + k] = 0.0


@compiled
def note_change(w: Any, stage: int) -> None:
    """Add the change of the slope of each bellows' energy since the last stage to the sum of this
    ``stage`` (0 to 2).
    """
    lanes = w.shape[0] // PER_LANE
    for i in range(lanes):
        slope = w[SLOPE + LaneState.ENERGY + i]
        w[Lane.CHANGED + LANES * stage + i] += abs(slope - w[Lane.KNOWN + i])
        w[Lane.KNOWN + i] = slope


@compiled_parallel
def integrate_lanes(
    w: Any,
    memory: Any,
    parameters: Any,
    sides: Any,
    courses: Any,
    valves: Any,
    rows: Any,
    dt: float,
    surfaces: bool,
    fed: bool,
    joined: bool,
    traces: Any,
) -> None:
    """Integrate all lanes to the end of the longest course with steps of ``dt`` s. ``w`` (LENGTH) holds their columns.

    Shapes: ``memory``, ``parameters``, ``sides``, ``rows`` (LANES), ``traces`` (LANES, most rows, TRACE). ``courses``
    and ``valves`` are tuples of the arrays in a `Course`. ``surfaces``, ``fed`` and ``joined`` are those of
    `ActiveTerms`.
    """
    saved = np.empty(LENGTH)
    turned = np.zeros(LANES, np.bool_)
    active = active_terms(w, surfaces, fed, joined)
    size = LaneState.EXTRA + 2 * LANES * active.extra
    recall(w, sides, memory, np.zeros(STATES))
    for k in range(size):
        w[START + k] = w[STAGE + k]
    last = traces.shape[1] - 1
    gather(w, 0, courses, rows)
    if fed:
        settle_levers(w, sides, parameters)
    for n in range(last + 1):
        move_valves(w, n, active, valves, rows, sides, memory, parameters)
        since = dt if n > 0 else 0.0
        lane_slope(w, since, active, sides, memory, parameters)
        if active.inert:
            note_flow(w)
        if note_motion(w, sides, memory, parameters, since, turned):
            saved[:] = w
            lane_slope(w, 0.0, active, sides, memory, parameters)
            restore(w, saved, turned)
        note_gas(w, sides, memory, parameters)
        note_trace(w, n, traces)
        if n == last:
            break
        note_change(w, 0)
        stage(w, size, 1.0, 0.5 * dt)
        gather(w, 2 * n + 1, courses, rows)
        lane_slope(w, 0.5 * dt, active, sides, memory, parameters)
        note_change(w, 1)
        stage(w, size, 2.0, 0.5 * dt)
        lane_slope(w, 0.5 * dt, active, sides, memory, parameters)
        note_change(w, 2)
        stage(w, size, 2.0, dt)
        gather(w, 2 * n + 2, courses, rows)
        lane_slope(w, dt, active, sides, memory, parameters)
        finish(w, size, dt)


def integrate_springs(springs: Sequence[LaneSpring]) -> list[NDArray[np.float64]]:
    """Return the trace (rows, TRACE) of each spring. At most LANES springs with equal step are possible. Other Python
    threads can run meanwhile.

    Unused lanes repeat the last spring. A spring that is too stiff for a long step gets a trace of NaN. Near the
    stability limit its values would be finite, but the gas would oscillate unphysically.
    """
    _check(springs, len(springs), LANES, "springs")
    return _integrate([*springs, *[springs[-1]] * (LANES - len(springs))], joined=False)[: len(springs)]


def integrate_pairs(
    pairs: Sequence[tuple[LaneSpring, LaneSpring]],
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return the traces of both springs of each bench, if air may flow between the sides. At most PAIRS benches are
    possible.
    """
    _check([spring for pair in pairs for spring in pair], len(pairs), PAIRS, "pairs of springs")
    filled = [*pairs, *[pairs[-1]] * (PAIRS - len(pairs))]
    traces = _integrate([left for left, _ in filled] + [right for _, right in filled], joined=True)
    return list(zip(traces[: len(pairs)], traces[PAIRS:], strict=False))


def _check(springs: Sequence[LaneSpring], count: int, limit: int, what: str) -> None:
    steps = sorted({spring.course.step for spring in springs})
    if not 0 < count <= limit or len(steps) > 1:
        raise ValueError(
            f"{count} {what} with steps of {steps} s cannot run together; use 1 to {limit} {what} with "
            "one step"
        )


def _integrate(filled: Sequence[LaneSpring], *, joined: bool) -> list[NDArray[np.float64]]:
    """Integrate one spring in each lane, and return their traces."""
    rows = np.array([len(spring.course.valves) for spring in filled])
    step = filled[0].course.step
    w = np.ascontiguousarray(np.column_stack([spring.column for spring in filled])).ravel()
    w[Lane.SHIFT : Lane.SHIFT + LANES] = [spring.shift for spring in filled]
    w[Lane.SUPPLY_ERROR : Lane.SUPPLY_ERROR + LANES] = [spring.supply_error for spring in filled]
    traces = np.empty((LANES, rows.max(), TRACE))
    integrate_lanes(
        w,
        np.zeros(LANES, MEMORY).view(np.recarray),
        np.array([spring.parameters for spring in filled], PARAMETERS).view(np.recarray),
        np.array([spring.side for spring in filled]),
        tuple(spring.course.places for spring in filled),
        tuple(spring.course.valves for spring in filled),
        rows,
        step,
        any(spring.surfaced for spring in filled),
        any(spring.course.fed for spring in filled),
        joined,
        traces,
    )
    if step > STEP:
        second, third = (w[row : row + LANES] for row in (Lane.CHANGED_2, Lane.CHANGED_3))
        traces[~(2.0 * third < STIFFEST * second)] = np.nan
    return [traces[k, :count] for k, count in enumerate(rows)]
