"""A replay: the springs follow the measured motion, and the model predicts the readings of their sensors.

Bolster and platform have their measured positions, so their inertia, the actuators and the platform drive are not
simulated. Gas, rubber and sensors of each side are predicted from the motion alone, and an error on one side does not
affect the other. The actuator forces follow from Newton's law for the bolster, whose acceleration is known from its
motion.
"""

from math import ceil
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bench_sim.model.actuator import bolster_point
from bench_sim.model.air_spring import air_spring
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.bellows import compliance_matrix, newton_step
from bench_sim.model.bolster import felt_acceleration, stop_force
from bench_sim.model.compiled import compiled, compiled_once, compiled_parallel
from bench_sim.model.layout import (
    ACTUATORS,
    EXTRA_BRANCHES,
    EXTRA_DASHPOTS,
    INPUTS,
    LATERAL,
    SENSORS,
    SIDES,
    STATES,
    State,
)
from bench_sim.model.quantities import MEMORY, PARAMETERS
from bench_sim.model.rest import fill_chamber, hold_back, relax_rubber, settle_sensors, settled_temperature
from bench_sim.model.runge_kutta import runge_kutta, step_scheme
from bench_sim.model.sensors import DRIFTS, follow, read_exactly, true_values
from bench_sim.model.spring import load_bellows, spring_algebra, stretch, tangent_of, volume
from bench_sim.model.step_start import begin

#: Displacements of a motion, in the order of the states: bolster lateral, vertical, roll; platform the same.
DIRECTIONS: Final = 6
#: Default of the longest step of a replay, s.
STEP: Final = 2.5e-3

#: Iterations of `settle`. Relaxed rubber is softer than its tangent, so each iteration leaves a part of the error.
_ROUNDS: Final = 30


@compiled
def hermite(part: float, rise: float, start: float, end: float) -> float:
    """Return the increase of a Hermite cubic from the start of an interval to a ``part`` (0 to 1) of it.

    ``rise`` is the increase over the whole interval. ``start`` and ``end`` are the slopes there, times the interval.
    """
    rest = 1.0 - part
    return part * part * (3.0 - 2.0 * part) * rise + part * rest * (rest * start - part * end)


@compiled
def place(n: int, part: float, motion: Any, x: Any) -> None:
    """Write the positions and speeds of bolster and platform to ``x``, at a ``part`` (0 to 1) of the interval after
    sample n.
    """
    q = motion.displacement
    if part == 0.0:  # at the sample itself, where most readings are made
        for k in range(DIRECTIONS):
            to = State.BOLSTER_LATERAL + k + (3 if k >= 3 else 0)
            x[to] = q[n, k]
            x[to + 3] = motion.speed[n, k]
        return
    a = part
    b = 1.0 - a
    for k in range(DIRECTIONS):
        # The speeds of the bolster follow its displacements, and the platform follows both.
        to = State.BOLSTER_LATERAL + k + (3 if k >= 3 else 0)
        rise = q[n + 1, k] - q[n, k]
        start = motion.interval * motion.speed[n, k]
        end = motion.interval * motion.speed[n + 1, k]
        x[to] = q[n, k] + hermite(a, rise, start, end)
        x[to + 3] = (
            6.0 * a * b * rise + b * (1.0 - 3.0 * a) * start + a * (1.0 - 3.0 * b) * end
        ) / motion.interval


@compiled_once
def moved_springs(ahead: float, x: Any, mem: Any, u: Any, par: Any, given: Any, dx: Any, out: Any) -> None:
    """Compute the right-hand side of the springs alone (`bench_sim.model.runge_kutta`), between plates with a given
    motion.

    ``given`` contains the index of the sample, the part of the interval after it, and the motion. Forces on the
    bolster are summed in the derivatives of its speeds.
    """
    n, part, motion = given
    place(n, part + ahead / motion.interval, motion, x)
    air_spring(mem.time + ahead, x, mem, u, par, dx, out)
    dx[State.SUPPLY_LINE] = 0.0  # it was measured as well


@compiled
def between(n: int, part: float, motion: Any, k: int) -> float:
    """Return the acceleration in direction ``k`` at a ``part`` (0 to 1) of the interval after sample n, on the cubic
    spline through the samples.

    Half-way between samples of 5 ms at 12.5 Hz the error is (ωh)⁴/384 = 0.006 %. Linear interpolation has an error of
    2 %.
    """
    before = motion.acceleration[n, k]
    if part == 0.0:
        return before
    rise = motion.acceleration[n + 1, k] - before
    start = motion.interval * motion.jerk[n, k]
    end = motion.interval * motion.jerk[n + 1, k]
    return before + hermite(part, rise, start, end)


@compiled
def balance(n: int, part: float, motion: Any, x: Any, par: Any, dx: Any, out: Any) -> None:
    """Compute the actuator forces on the bolster by Newton's law, from the spring forces that are summed in ``dx``.

    F_a = m ÿ − ΣF_y − F_bs;  F_l + F_r = ΣF_z − m (z̈ + g);  (F_l − F_r) b_a = ΣM − h_a F_a − J φ̈
    """
    y = between(n, part, motion, 0)
    z = between(n, part, motion, 1)
    phi = between(n, part, motion, 2)
    for k in range(2):
        out[Algebraic.PLATFORM_ACCELERATION + k] = between(n, part, motion, 3 + k)
    bump = stop_force(x[State.BOLSTER_LATERAL] - x[State.PLATFORM_LATERAL], par)
    lateral = par.bolster_mass * y - dx[State.BOLSTER_LATERAL_SPEED] - bump
    both = dx[State.BOLSTER_VERTICAL_SPEED] - par.bolster_mass * (z + par.gravity)
    moment = dx[State.BOLSTER_ROLL_SPEED] - par.lateral_actuator_height * lateral
    difference = (moment - par.bolster_inertia * phi) / par.actuator_half_spacing
    out[Algebraic.BUMP_STOP] = bump
    out[Algebraic.LATERAL_ACCELERATION] = y
    out[Algebraic.ACCELEROMETER] = felt_acceleration(x[State.BOLSTER_ROLL], y, z, phi, par)
    out[Algebraic.ACTUATOR_FORCE] = 0.5 * (both + difference)
    out[Algebraic.ACTUATOR_FORCE + 1] = 0.5 * (both - difference)
    out[Algebraic.ACTUATOR_FORCE + LATERAL] = lateral
    for j in range(ACTUATORS):
        out[Algebraic.ACTUATOR_DISPLACEMENT + j], out[Algebraic.ACTUATOR_SPEED + j] = bolster_point(x, par, j)


@compiled_once
def settle(x: Any, mem: Any, par: Any, gas: Any, before: Any, out: Any) -> None:
    """Fill the chambers and relax the rubber, with the bolster at rest at its present position.

    The rubber keeps only the deformation in ``before`` (`Before`). Newton's method solves two equations at constant
    pressure: ζ_b = ζ + q + (F_z−P)/k_z and y_b = y + F_y/k_y. The pressure is constant because the pressure is given
    and not the energy. This also works if the plate sits on the emergency spring, which doubles the stiffness.
    """
    pressure, temperature = gas.pressure, gas.temperature
    for i in range(SIDES):
        x[State.CREEP + i] = before.crept[i]
        fill_chamber(x, par, State.BELLOWS_MASS + i, pressure[i], par.bellows_volume[i], temperature[i])
        volume_a = par.auxiliary_volume[i]
        fill_chamber(x, par, State.AUXILIARY_MASS + i, pressure[2 + i], volume_a, temperature[2 + i])
        x[State.BELLOWS_WALL + i] = x[State.AUXILIARY_WALL + i] = settled_temperature(par)
    spring_algebra(mem.time, x, mem, par, out)  # position of the springs: their gas is not correct yet
    for i in range(SIDES):
        z = out[Algebraic.HEIGHT + i] + x[State.CREEP + i]
        y = out[Algebraic.LATERAL + i]
        z_b = z
        y_b = y
        for _ in range(_ROUNDS):
            V = volume(par, i, z_b, y_b) + stretch(par, i, z_b, pressure[i])
            fill_chamber(x, par, State.BELLOWS_MASS + i, pressure[i], V, temperature[i])
            relax_rubber(x, mem, i, z_b, y_b)
            hold_back(x, i, before.behind)
            load_bellows(x, mem, par, i, z_b, y_b, out)
            if par.emergency_spring == 0.0:
                break
            c_z = 1.0 / par.emergency_stiffness_vertical[i]
            c_y = 1.0 / par.emergency_stiffness_lateral[i]
            miss_z = z - z_b + c_z * (out[Algebraic.STACK_VERTICAL + i] - par.nominal_preload[i])
            miss_y = y - y_b + c_y * out[Algebraic.STACK_LATERAL + i]
            a, b, c, d = compliance_matrix(*tangent_of(i, out), c_z, c_y, 0.0)
            step_z, step_y = newton_step(a, b, c, d, miss_z, miss_y)
            z_b += step_z
            y_b += step_y
        mem.friction_last[0, i] = mem.bellows_vertical[i] = z_b
        mem.friction_last[1, i] = mem.bellows_lateral[i] = y_b
        x[State.LEVER + i] = out[Algebraic.HEIGHT + i] + par.lever_offset[i]


@compiled_parallel
def replay_samples(
    x: Any,
    memory: Any,
    parameters: Any,
    since: Any,
    motion: Any,
    inputs: Any,
    supply: Any,
    gas: Any,
    before: Any,
    steps: int,
    readings: Any,
    rows: Any,
) -> None:
    """Start at rest, integrate with ``steps`` steps per interval, and write the readings at each sample.

    Shapes for n samples: ``inputs`` (n, INPUTS), ``supply`` (n), ``readings`` (n, SENSORS), ``rows`` (n or 0,
    ALGEBRAICS). Each of the ``parameters`` (m) applies from its sample in ``since`` (m) on, the first from sample 0.
    """
    mem = memory[0]
    par = parameters[0]
    turned = 1
    work = np.zeros((5, STATES))
    out = np.zeros(ALGEBRAICS)
    values, ideal = np.zeros(SENSORS), np.zeros(SENSORS)
    dt = motion.interval / steps
    pieces, states = step_scheme(par, dt)
    last = motion.displacement.shape[0] - 1
    place(0, 0.0, motion, x)
    settle(x, mem, par, gas, before, out)
    for n in range(last + 1):
        if turned < since.shape[0] and since[turned] == n:
            par = parameters[turned]
            pieces, states = step_scheme(par, dt)
            turned += 1
        u = inputs[n]
        x[State.SUPPLY_LINE] = supply[n]
        interval = min(n, last - 1)  # the last sample is the end of the interval before it
        for k in range(steps if n < last else 1):
            part = k / steps if n < last else 1.0
            slope = work[0]
            begin(moved_springs, x, mem, u, par, (interval, part, motion), slope, out)
            balance(interval, part, motion, x, par, slope, out)
            true_values(x, mem, par, out, values)
            if k == 0:
                if n == 0:
                    settle_sensors(mem, par, values, dt)
                ideal[:] = values
                read_exactly(mem, par, ideal, readings[n])
                if n < rows.shape[0]:
                    rows[n] = out
            if n == last:
                break
            follow(mem, par, values, dt)
            for piece in range(pieces):
                given = n, part + piece / (pieces * steps), motion
                if piece > 0:
                    moved_springs(0.0, x, mem, u, par, given, slope, out)
                runge_kutta(moved_springs, dt / pieces, states, x, mem, u, par, given, work, out)
            mem.step += 1


class Motion(NamedTuple):
    """Positions of bolster and platform every ``interval`` s, connected by cubics. Compiled code can use
    it directly.
    """

    interval: float
    displacement: NDArray[np.float64]  #: (n, DIRECTIONS), m and rad
    speed: NDArray[np.float64]  #: (n, DIRECTIONS)
    acceleration: NDArray[np.float64]  #: (n, DIRECTIONS)
    jerk: NDArray[np.float64]  #: (n, DIRECTIONS), the slopes of the cubic spline through the accelerations

    @classmethod
    def through(cls, displacement: NDArray[np.float64], interval: float) -> "Motion":
        """Return the motion along the cubic spline through samples (n, DIRECTIONS). Its accelerations are
        continuous.
        """
        if displacement.ndim != 2 or displacement.shape[1] != DIRECTIONS or len(displacement) < 4:
            raise ValueError(
                f"a motion has shape {displacement.shape}; at least 4 samples of {DIRECTIONS} displacements are needed"
            )
        if not np.isfinite(displacement).all():
            raise ValueError("a motion has gaps (NaN); fill them before it is replayed")
        time = interval * np.arange(len(displacement))
        spline = CubicSpline(time, displacement)
        acceleration = spline(time, 2)
        samples = displacement, spline(time, 1), acceleration, CubicSpline(time, acceleration)(time, 1)
        return cls(interval, *(np.ascontiguousarray(rows, dtype=np.float64) for rows in samples))

    def accelerated(self, direction: int, acceleration: NDArray[np.float64]) -> "Motion":
        """Return a copy with a separately measured ``acceleration`` (n,) in one direction."""
        if acceleration.shape != (len(self.displacement),) or not np.isfinite(acceleration).all():
            raise ValueError(
                f"an acceleration has shape {acceleration.shape} and {np.isnan(acceleration).sum()} "
                f"gaps (NaN); use the shape ({len(self.displacement)},) without gaps"
            )
        time = self.interval * np.arange(len(acceleration))
        both = self.acceleration.copy(), self.jerk.copy()
        both[0][:, direction] = acceleration
        both[1][:, direction] = CubicSpline(time, acceleration)(time, 1)
        return self._replace(acceleration=both[0], jerk=both[1])


class Gas(NamedTuple):
    """The gas at rest in the bellows (left, right), then in the auxiliary chambers (left, right)."""

    pressure: NDArray[np.float64]  #: (4,), Pa absolute
    temperature: NDArray[np.float64]  #: (4,), K


class Before(NamedTuple):
    """The deformation that the rubber still has from the motion before a replay begins."""

    crept: NDArray[np.float64]  #: (SIDES,) m by which the emergency springs have crept together
    #: (EXTRA_BRANCHES, EXTRA_DASHPOTS) m by which the dash-pots of the extra branches are behind their bellows
    behind: NDArray[np.float64]

    @classmethod
    def at_rest(cls) -> "Before":
        """Return the state of fully relaxed rubber."""
        return cls(np.zeros(SIDES), np.zeros((EXTRA_BRANCHES, EXTRA_DASHPOTS)))


class ParameterChanges(NamedTuple):
    """Changes of parameters during a replay: each record applies from its sample on."""

    samples: NDArray[np.intp]  #: (m,), each later than the one before, the first one after sample 0
    records: Any  #: (m,) of ``PARAMETERS``


def replay(
    parameters: Any,
    motion: Motion,
    inputs: NDArray[np.float64],
    supply: NDArray[np.float64],
    gas: Gas,
    *,
    step: float = STEP,
    start: float = 0.0,
    before: Before | None = None,
    rows: NDArray[np.float64] | None = None,
    changes: ParameterChanges | None = None,
) -> NDArray[np.float64]:
    """Return the readings of each sensor (n, SENSORS) for ``motion`` of the bench, without noise and quantisation.

    ``parameters`` is a record (``bench_sim.parameters.Parameters.record``). ``inputs`` (n, INPUTS) are the valves
    during each interval, ``supply`` (n) is the absolute pressure behind the main valve in Pa. The replay starts at rest
    with relaxed rubber, except for the deformation in ``before``. It starts ``start`` s after the bench was switched
    on; sensors drift from that moment. The steps are equal parts of an interval, at most ``step`` s long. ``rows`` (n,
    ALGEBRAICS) is filled with the algebraic variables behind the readings. At ``changes`` masses, energies and
    dash-pots keep their values, and changed drifts start there. If readings get a delay by a change, they must have a
    small delay from the start. Other Python threads can run meanwhile. Raises ValueError for a ``step`` above `STEP`
    and for wrong shapes.
    """
    if not 0.0 < step <= STEP:
        raise ValueError(
            f"step = {step * 1e3:g} ms is not stable; use more than 0 and at most {STEP * 1e3:g} ms"
        )
    n = len(motion.displacement)
    if inputs.shape != (n, INPUTS) or supply.shape != (n,):
        raise ValueError(
            f"inputs {inputs.shape} and supply {supply.shape} do not fit {n} samples of motion; use "
            f"the shapes ({n}, {INPUTS}) and ({n},)"
        )
    record = np.array([parameters], PARAMETERS)
    since = np.zeros(1, np.intp)
    if changes is not None:
        record, since = np.concatenate((record, changes.records)), np.concatenate((since, changes.samples))
        _drift_from(np.asarray(start + motion.interval * since), record)
    memory = np.zeros(1, MEMORY).view(np.recarray)
    memory.time = memory.solved_time = start
    readings = np.empty((n, SENSORS))
    replay_samples(
        np.zeros(STATES),
        memory,
        record.view(np.recarray),
        since,
        motion,
        inputs,
        supply,
        gas,
        before or Before.at_rest(),
        ceil(motion.interval / step - 1e-9),
        readings,
        np.empty((0, ALGEBRAICS)) if rows is None else rows,
    )
    return readings


def _drift_from(times: NDArray[np.float64], records: Any) -> None:
    """Change the offsets in ``records`` (m,) so that drifts and a slow clock start at ``times`` (m,) s."""
    for rate, start in DRIFTS:
        more = np.diff(records[rate], axis=0, prepend=records[rate][:1])
        records[start] -= np.cumsum((times * more.T).T, axis=0)
