"""A bench whose springs are computed by an external library with a fixed communication step.

At the start of each communication step the library receives the motion of the springs, and returns the forces at the
end of the step. The displacements at the end are predicted from position, speed and acceleration at the start, with an
error of third order. Between start and end the forces are interpolated linearly. The rest of the bench is integrated
as with built-in springs.
"""

from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_sim.model.actuator import actuator_term
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.bolster import bolster_term, platform_term
from bench_sim.model.compiled import compiled, compiled_once
from bench_sim.model.gas import energy_of
from bench_sim.model.layout import Input, State
from bench_sim.model.spring import displacements, load_bolster
from bench_sim.model.valves import (
    dpv_term,
    leveling_term,
    lever_term,
    service_term,
    supply_term,
    switch_valves,
)


class Feed(IntEnum):
    """Quantities that the bench can send to external springs, in SI units. A pair holds left and right."""

    HEIGHT = 0  #: over design height, m
    HEIGHT_SPEED = 2
    HEIGHT_ACCELERATION = 4
    LATERAL = 6  #: top plates against the feet, m to the left
    LATERAL_SPEED = 7
    LATERAL_ACCELERATION = 8
    ROLL = 9  #: of the bolster against the platform, rad
    ROLL_SPEED = 10
    ROLL_ACCELERATION = 11
    SUPPLY = 12  #: main valve: 1 open
    LEVELING = 13  #: valve: 1 connected
    SERVICE_VALVE = 15  #: −1 exhausts to 1 fills
    RESERVOIR = 17  #: 1 open
    DPV = 19  #: 1 connected
    SUPPLY_PRESSURE = 20  #: Pa gauge
    AIR_FLOW = 21  #: kg/s through all valves of the bench into the spring
    AIR_POWER = 23  #: W, the enthalpy of that air
    NOMINAL_PRELOAD = 25  #: N, for which shims set the height to zero
    ORIFICE_DIAMETER = 27  #: m, of the plate that is fitted


FEEDS: Final = 29
#: Index of an output in addition to those of `Algebraic`: the supply pressure. All pressures of springs are gauge, Pa.
SUPPLY_TAKEN: Final = ALGEBRAICS


class Slot(IntEnum):
    """Indices of ``numbers`` in `ExternalSprings`."""

    ON = 0  #: 1: the springs are external
    INSTANCES = 1
    TICKS = 2  #: of one communication step
    TICK = 3  #: ticks of this communication step that have passed
    STEPS = 4  #: communication steps so far
    TAKES = 5  #: number of outputs of the springs
    VALVES = 6  #: 1: the bench's valves feed the springs
    HOLD = 7  #: `Hold`
    FAILED = 8  #: `bench_sim.rig.external_springs.Failure`
    CALL = 9  #: `bench_sim.rig.external_springs.Call`: the present call, or the one that failed
    INSTANCE = 10  #: the instance of that call
    STATUS = 11  #: the status that the call returned, or the index of an output that is not a number
    APART = 12  #: 1: the library runs in a separate process
    ASK = 13  #: file descriptors to that process and from it
    ANSWER = 14
    PATIENCE = 15  #: ms that an answer may take
    BENDS = 16  #: 1: the springs also receive accelerations
    SPARE = 17
    FLAGS = 18


class Hold(IntEnum):
    """The instant within a communication step whose displacement the springs receive."""

    BEGIN = 0  #: the springs extrapolate with the speed
    MIDDLE = 1
    END = 2


#: Columns of an instance.
COMPONENT, SET, STEP, GET, VERSION, INPUT, OUTPUT = range(7)


class ExternalSprings(NamedTuple):
    """The data of external springs; all are 0 with built-in springs. A row holds the inputs or outputs of all
    instances.
    """

    numbers: npt.NDArray[np.int64]  #: `Slot`
    clock: npt.NDArray[np.float64]  #: s: start and length of the present communication step, working memory
    instances: npt.NDArray[
        np.int64
    ]  #: addresses; the first input and output of each; one row more for the end
    input_references: npt.NDArray[np.uint32]
    output_references: npt.NDArray[np.uint32]
    fed: npt.NDArray[np.int64]  #: `Feed` of each input
    feed_scale: npt.NDArray[np.float64]  #: (inputs, 2) scale and zero: FMU number = scale · SI value + zero
    inputs: npt.NDArray[np.float64]  #: (2, inputs): values for the step, and values at its end
    taken: npt.NDArray[np.int64]  #: `Algebraic` of each output, or `SUPPLY_TAKEN`
    take_scale: npt.NDArray[np.float64]  #: (outputs, 2) scale and zero: SI value = scale · output + zero
    outputs: npt.NDArray[np.float64]
    known: npt.NDArray[np.float64]  #: (2, outputs), SI: at the beginning and the end of the step
    feeds: npt.NDArray[np.float64]  #: (FEEDS,), SI

    @classmethod
    def none(cls) -> "ExternalSprings":
        """Return the data of a bench with built-in springs."""
        return cls.of_size(0, 0, 0)

    @classmethod
    def of_size(cls, instances: int, inputs: int, outputs: int) -> "ExternalSprings":
        """Return data with newly allocated arrays for these numbers of instances, inputs and outputs."""
        return cls(*(np.zeros(shape, kind) for shape, kind in layout(instances, inputs, outputs)))


def layout(instances: int, inputs: int, outputs: int) -> tuple[tuple[tuple[int, ...], Any], ...]:
    """Return shape and type of each array of `ExternalSprings`."""
    return (
        ((len(Slot),), np.int64),
        ((3,), np.float64),
        ((instances + 1, 7), np.int64),
        ((inputs,), np.uint32),
        ((outputs,), np.uint32),
        ((inputs,), np.int64),
        ((inputs, 2), np.float64),
        ((2, inputs), np.float64),
        ((outputs,), np.int64),
        ((outputs, 2), np.float64),
        ((outputs,), np.float64),
        ((2, outputs), np.float64),
        ((FEEDS,), np.float64),
    )


#: States whose derivatives are sums of terms, and those that are integrated.
_SUMMED: Final = int(State.EXTRA_VERTICAL_DASHPOT)
INTEGRATED: Final = int(State.PIPE_FLOW)
#: Number of the bench's valve inputs, which are the first inputs.
_VALVES: Final = Input.DPV_CONNECTED + 1


@compiled
def know_outputs(e: Any) -> None:
    """Convert the outputs of the library to SI values, which are valid at the end of the communication step."""
    for k in range(e.numbers[Slot.TAKES]):
        e.known[1, k] = e.take_scale[k, 0] * e.outputs[k] + e.take_scale[k, 1]


@compiled
def _spread(e: Any, share: float, x: Any, par: Any, out: Any) -> None:
    """Write the interpolated outputs of the springs after a ``share`` (0 to 1) of the communication step."""
    atmosphere = par.atmospheric_pressure
    for k in range(e.numbers[Slot.TAKES]):
        value = e.known[0, k] + share * (e.known[1, k] - e.known[0, k])
        place = e.taken[k]
        if place == SUPPLY_TAKEN:
            x[State.SUPPLY_LINE] = value + atmosphere
            continue
        pressure = Algebraic.PRESSURE <= place < Algebraic.TEMPERATURE
        if pressure or Algebraic.AUXILIARY_PRESSURE <= place < Algebraic.AUXILIARY_TEMPERATURE:
            value += atmosphere
        out[place] = value


@compiled_once
def evaluate_around(ahead: float, x: Any, mem: Any, u: Any, par: Any, given: Any, dx: Any, out: Any) -> None:
    """Compute the right-hand side (`bench_sim.model.runge_kutta`) of the bench with external springs.

    ``given`` contains the `ExternalSprings`, the elapsed share of the communication step, and the share per second.
    """
    e, share, rate = given
    for k in range(_SUMMED):
        dx[k] = 0.0
    displacements(x, par, out)
    supply_term(mem.time + ahead, x, u, par, dx)
    _spread(e, share + rate * ahead, x, par, out)
    lever_term(x, par, out, dx)
    for i in range(2):
        F_z, F_y = out[Algebraic.VERTICAL_FORCE + i], out[Algebraic.LATERAL_FORCE + i]
        load_bolster(par, i, F_z, F_y, out[Algebraic.ROLL_MOMENT + i], dx)
    actuator_term(x, mem, par, out, dx)
    bolster_term(x, par, out, dx)
    platform_term(x, u, par, out, dx)


@compiled
def _accelerations(x: Any, par: Any, dx: Any) -> tuple[float, float, float]:
    """Return three accelerations of the springs: mean height (m/s²), roll (rad/s²) and lateral (m/s²)."""
    vertical = dx[State.BOLSTER_VERTICAL_SPEED] - dx[State.PLATFORM_VERTICAL_SPEED]
    roll = dx[State.BOLSTER_ROLL_SPEED] - dx[State.PLATFORM_ROLL_SPEED]
    lateral = dx[State.BOLSTER_LATERAL_SPEED] + par.centre_height * dx[State.BOLSTER_ROLL_SPEED]
    lateral += -dx[State.PLATFORM_LATERAL_SPEED] + par.column_height * dx[State.PLATFORM_ROLL_SPEED]
    return vertical, roll, lateral


@compiled
def write_feeds(
    feeds: Any, after: float, after_speed: float, x: Any, u: Any, par: Any, dx: Any, out: Any
) -> None:
    """Write all quantities that springs can receive to ``feeds`` (FEEDS).

    Displacements are extrapolated by ``after`` s and speeds by ``after_speed`` s, with the accelerations in ``dx``.
    """
    vertical, roll, lateral = _accelerations(x, par, dx)
    for i in range(2):
        a = vertical + (1.0 - 2.0 * i) * par.spring_half_spacing * roll
        v = out[Algebraic.HEIGHT_SPEED + i]
        feeds[Feed.HEIGHT + i] = out[Algebraic.HEIGHT + i] + after * (v + 0.5 * after * a)
        feeds[Feed.HEIGHT_SPEED + i] = v + after_speed * a
        feeds[Feed.HEIGHT_ACCELERATION + i] = a
        feeds[Feed.NOMINAL_PRELOAD + i] = par.nominal_preload[i]
        feeds[Feed.ORIFICE_DIAMETER + i] = par.orifice_diameter[i]
        feeds[Feed.AIR_FLOW + i] = dx[State.AUXILIARY_MASS + i]
        feeds[Feed.AIR_POWER + i] = dx[State.AUXILIARY_ENERGY + i]
    v = out[Algebraic.LATERAL_SPEED]
    feeds[Feed.LATERAL] = out[Algebraic.LATERAL] + after * (v + 0.5 * after * lateral)
    feeds[Feed.LATERAL_SPEED] = v + after_speed * lateral
    feeds[Feed.LATERAL_ACCELERATION] = lateral
    v = x[State.BOLSTER_ROLL_SPEED] - x[State.PLATFORM_ROLL_SPEED]
    feeds[Feed.ROLL] = out[Algebraic.ROLL] + after * (v + 0.5 * after * roll)
    feeds[Feed.ROLL_SPEED] = v + after_speed * roll
    feeds[Feed.ROLL_ACCELERATION] = roll
    for k in range(_VALVES):
        feeds[Feed.SUPPLY + k] = u[Input.SUPPLY + k]
    feeds[Feed.SUPPLY_PRESSURE] = x[State.SUPPLY_LINE] - par.atmospheric_pressure


@compiled
def feed_inputs(e: Any, x: Any, u: Any, par: Any, dx: Any, out: Any) -> None:
    """Write the inputs of all instances, computed from the derivatives ``dx`` at the start of the communication step.

    Springs that extrapolate with the speed alone receive the mean speed of the step.
    """
    T, n = e.clock[1], e.numbers
    hold = 0.5 * n[Slot.HOLD] * T
    mean = n[Slot.HOLD] == Hold.BEGIN and n[Slot.BENDS] == 0
    for row in range(2):
        after = hold if row == 0 else T
        write_feeds(e.feeds, after, 0.5 * T if mean and row == 0 else after, x, u, par, dx, out)
        for k in range(e.fed.size):
            e.inputs[row, k] = e.feed_scale[k, 0] * e.feeds[e.fed[k]] + e.feed_scale[k, 1]


@compiled
def let_air_in(e: Any, x: Any, mem: Any, u: Any, par: Any, dx: Any, out: Any) -> None:
    """Switch the bench's valves, and add their air flow to the derivatives ``dx`` of the auxiliary chambers. Do nothing
    if the library has no input for this air flow.
    """
    if e.numbers[Slot.VALVES] == 0:
        return
    for i in range(2):
        x[State.AUXILIARY_ENERGY + i] = energy_of(
            out[Algebraic.AUXILIARY_PRESSURE + i], par.auxiliary_volume[i], par.heat_capacity_ratio
        )
    switch_valves(x, mem, par)
    leveling_term(x, mem, u, par, out, dx)
    service_term(x, u, par, out, dx)
    dpv_term(mem, u, par, out, dx)
