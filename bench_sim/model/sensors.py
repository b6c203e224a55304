"""The measuring chain: s_m = (1+g) D H s + b + d t + Σ c_jk D H s_k + noise, quantised and limited to the sensor's
range.

The lag H = 1/(1+τs) is discretised for an input that is a cubic through the last four samples. So a τ far below the
step acts as a delay τ, linear in τ down to zero. The delay D of a group of sensors uses the same cubics, through the
outputs of the last `HISTORY` steps. It is limited to their duration (0.25 s at 1 ms). Linear interpolation would damp
an oscillation by ω²h²/12 (lag) and ω²h²/8 (delay) at a step h, and parabolas would shift its phase in proportion to
(ωh)³. A lag and a delay of τ differ by ω²τ²/2, which is of the same size for τ of one millisecond.
"""

from math import exp, floor
from typing import Any, Final

from bench_sim.model.actuator import piston_displacement
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.compiled import compiled, compiled_once
from bench_sim.model.layout import ACTUATORS, HISTORY, SENSORS, TINY, Sensor, State
from bench_sim.model.noise import normal

#: Sign of the additional force of each vertical cell under a twisted platform.
DIAGONAL = (1.0, -1.0, -1.0, 1.0)
#: Errors of a sensor that grow with time: the name of the rate, and the name of the error at time 0.
DRIFTS: Final = (("sensor_drift", "sensor_bias"), ("pressure_clock_skew", "pressure_latency"))


@compiled
def load_cell_term(par: Any, out: Any, values: Any) -> None:
    """Write the readings of the six load cells under the platform, from the forces and moments of springs and
    actuators.

    F_z = ΣF_k (four vertical cells, compression positive). F_y = F_5 + F_6 (the force of springs and bump stop on the
    bolster). M_x = Σ y_k F_k − z_c F_y about the middle of the platform, where the moment of the springs is Σ (M_i +
    s_i b F_z,i − h F_y,i). With seats x_i and actuators x_l in front of the middle, Σ x_k F_k = Σ x_i F_z,i + x_l ΣF_a
    for the vertical cells, and Σ x_k F_k = Σ x_i F_y,i for the lateral cells. b is half the distance between the
    springs, s_i is 1 (left) or −1 (right), h is ``column_height``, z_c is ``load_cell_height``. The weight of the
    platform is tared. The cells measure its inertia m z̈_P and m ÿ_P (``platen_mass``, 0 in a rig that compensates it).

    The balance of forces does not determine the twist a (1, −1, −1, 1) of four supports. It follows from the least
    energy of a rigid platform on supports with (1 + δ_k) times the common compliance: a = (4w − Σ ±_k δ_k F_k) / (4 +
    Σδ_k). Here w is the twist of equally stiff supports that are not in one plane.
    """
    left = out[Algebraic.VERTICAL_FORCE]
    right = out[Algebraic.VERTICAL_FORCE + 1]
    F_z = left + right
    F_y = out[Algebraic.LATERAL_FORCE] + out[Algebraic.LATERAL_FORCE + 1]
    M_x = (
        out[Algebraic.ROLL_MOMENT]
        + out[Algebraic.ROLL_MOMENT + 1]
        + par.spring_half_spacing * (left - right)
        - par.column_height * F_y
    )
    F_y += out[Algebraic.BUMP_STOP] + par.platen_mass * out[Algebraic.PLATFORM_ACCELERATION]
    F_z += par.platen_mass * out[Algebraic.PLATFORM_ACCELERATION + 1]
    tilt = (M_x + par.load_cell_height * F_y) / (4.0 * par.load_cell_y)
    pressed = out[Algebraic.ACTUATOR_FORCE] + out[Algebraic.ACTUATOR_FORCE + 1]
    ahead = par.seat_ahead[0] * left + par.seat_ahead[1] * right + par.load_ahead * pressed
    turn = (
        par.seat_ahead[0] * out[Algebraic.LATERAL_FORCE]
        + par.seat_ahead[1] * out[Algebraic.LATERAL_FORCE + 1]
    )
    pitch = ahead / (4.0 * par.load_cell_x)
    yaw = turn / (2.0 * par.load_cell_x)
    values[Sensor.LOAD_CELL_1] = 0.25 * F_z + tilt + pitch
    values[Sensor.LOAD_CELL_2] = 0.25 * F_z - tilt + pitch
    values[Sensor.LOAD_CELL_3] = 0.25 * F_z + tilt - pitch
    values[Sensor.LOAD_CELL_4] = 0.25 * F_z - tilt - pitch
    values[Sensor.LOAD_CELL_5] = 0.5 * F_y + yaw
    values[Sensor.LOAD_CELL_6] = 0.5 * F_y - yaw
    softer = 0.0
    twist = 4.0 * par.platform_twist
    for k in range(4):
        delta = par.support_softness[k]
        softer += delta
        twist -= DIAGONAL[k] * delta * values[Sensor.LOAD_CELL_1 + k]
    twist /= 4.0 + softer
    for k in range(4):
        values[Sensor.LOAD_CELL_1 + k] += DIAGONAL[k] * twist


@compiled
def true_values(x: Any, mem: Any, par: Any, out: Any, values: Any) -> None:
    """Write the readings of ideal sensors to ``values`` (SI, pressures gauge), in the order of `Sensor`."""
    atmosphere = par.atmospheric_pressure
    for i in range(2):
        values[Sensor.LEFT_HEIGHT + i] = out[Algebraic.HEIGHT + i]
        values[Sensor.LEFT_BELLOWS_PRESSURE + i] = out[Algebraic.PRESSURE + i] - atmosphere
        values[Sensor.LEFT_AUXILIARY_PRESSURE + i] = out[Algebraic.AUXILIARY_PRESSURE + i] - atmosphere
        values[Sensor.LEFT_BELLOWS_TEMPERATURE + i] = out[Algebraic.TEMPERATURE + i]
        values[Sensor.LEFT_AUXILIARY_TEMPERATURE + i] = out[Algebraic.AUXILIARY_TEMPERATURE + i]
    values[Sensor.SUPPLY_PRESSURE] = x[State.SUPPLY_LINE] - atmosphere
    for j in range(ACTUATORS):
        force = out[Algebraic.ACTUATOR_FORCE + j]
        values[Sensor.VERTICAL_LEFT_FORCE + j] = force
        values[Sensor.VERTICAL_LEFT_DISPLACEMENT + j] = piston_displacement(
            x, mem, par, j, force, out[Algebraic.ACTUATOR_DISPLACEMENT + j]
        )
    load_cell_term(par, out, values)
    values[Sensor.LATERAL_ACCELERATION] = out[Algebraic.ACCELEROMETER]
    values[Sensor.PLATFORM_VERTICAL] = x[State.PLATFORM_VERTICAL]
    values[Sensor.PLATFORM_LATERAL] = x[State.PLATFORM_LATERAL]
    values[Sensor.PLATFORM_ROLL] = x[State.PLATFORM_ROLL]


@compiled
def prepare_lags(mem: Any, par: Any, dt: float) -> None:
    """Compute e = e^{−dt/τ}, g = θ(1 − e), b = θ(g − e) − g/2 and c = θ(3g − 6b − e − 2)/6 of all sensors, with θ =
    τ/dt.

    A sensor is computed again only if τ or dt has changed.
    """
    fresh = mem.lag_step != dt
    mem.lag_step = dt
    for k in range(SENSORS):
        tau = par.sensor_lag[k]
        if fresh or tau != mem.lag_time[k]:
            mem.lag_time[k] = tau
            decay = exp(-dt / tau) if tau > 0.0 else 0.0
            mem.lag_decay[k] = decay
            ramp = tau / dt * (1.0 - decay)
            bend = tau / dt * (ramp - decay) - 0.5 * ramp
            mem.lag_ramp[k] = ramp
            mem.lag_bend[k] = bend
            mem.lag_twist[k] = tau / dt * (3.0 * ramp - 6.0 * bend - decay - 2.0) / 6.0


@compiled
def curves(mem: Any) -> tuple[float, float]:
    """Return the weights (0 or 1) of the second and third differences. In the first steps they are 0, because there
    are no earlier values.
    """
    return (1.0 if mem.step > 1 else 0.0), (1.0 if mem.step > 2 else 0.0)


@compiled
def lagged(mem: Any, k: int, value: float, bends: float, twists: float) -> float:
    """Return the output y_n of the lag of sensor ``k`` for its input s_n = ``value``. The output is not stored.

    y_n = e y_{n−1} + (1 − g) s_n + (g − e) s_{n−1} + ``bends`` b Δ²s_n + ``twists`` c Δ³s_n

    The coefficients are those of `prepare_lags`. ``bends`` and ``twists`` (0 or 1, from `curves`) switch off the
    differences in the first steps.
    """
    decay = mem.lag_decay[k]
    ramp = mem.lag_ramp[k]
    last = mem.sensor_input[k]
    before = mem.sensor_input_before[k]
    bend = value - 2.0 * last + before
    twist = bend - (last - 2.0 * before + mem.sensor_input_earlier[k])
    return (
        decay * mem.sensor_output[k]
        + (1.0 - ramp) * value
        + (ramp - decay) * last
        + bends * mem.lag_bend[k] * bend
        + twists * mem.lag_twist[k] * twist
    )


@compiled
def arrives_late(par: Any) -> bool:
    """Return whether any reading is delayed."""
    return (
        par.force_latency > 0.0
        or par.pressure_latency > 0.0
        or par.displacement_latency > 0.0
        or par.pressure_clock_skew > 0.0
        or par.pressure_hold > 0.0
    )


@compiled
def lateness(mem: Any, par: Any, sensor: int) -> float:
    """Return the age in s of a reading of one sensor. Pressures can be held, and can have a slow clock of their own."""
    if Sensor.LEFT_BELLOWS_PRESSURE <= sensor <= Sensor.SUPPLY_PRESSURE:
        age = 0.0
        if par.pressure_hold > 0.0:
            # Time is a sum of steps: a microsecond more puts it on the right side of the start of a period.
            begun = floor((mem.time + 1e-6) / par.pressure_hold_period)
            age = max(mem.time - begun * par.pressure_hold_period, 0.0)
        return par.pressure_latency + par.pressure_clock_skew * mem.time + par.pressure_hold * age
    transducer = Sensor.VERTICAL_LEFT_FORCE <= sensor <= Sensor.LATERAL_FORCE
    if transducer or Sensor.LOAD_CELL_1 <= sensor <= Sensor.LOAD_CELL_6:
        return par.force_latency
    height = sensor <= Sensor.RIGHT_HEIGHT
    piston = Sensor.VERTICAL_LEFT_DISPLACEMENT <= sensor <= Sensor.LATERAL_DISPLACEMENT
    if height or piston or Sensor.PLATFORM_VERTICAL <= sensor <= Sensor.PLATFORM_ROLL:
        return par.displacement_latency
    return 0.0


@compiled
def delayed(mem: Any, sensor: int, value: float, delay: float) -> float:
    """Return the output of a sensor ``delay`` s ago, by cubic interpolation between steps. ``value`` is the present
    output.
    """
    back = min(delay / mem.lag_step, HISTORY - 3.0)
    steps = int(back)
    part = back - steps
    newer = value if steps == 0 else mem.sensor_history[sensor, (mem.step - steps) % HISTORY]
    older = mem.sensor_history[sensor, (mem.step - steps - 1) % HISTORY]
    oldest = mem.sensor_history[sensor, (mem.step - steps - 2) % HISTORY]
    before = mem.sensor_history[sensor, (mem.step - steps - 3) % HISTORY]
    bend = newer - 2.0 * older + oldest
    twist = older - 2.0 * oldest + before - bend
    return (
        newer
        + part * (older - newer)
        + 0.5 * part * (part - 1.0) * bend
        + part * (part - 1.0) * (part - 2.0) / 6.0 * twist
    )


@compiled
def follow(mem: Any, par: Any, values: Any, dt: float) -> None:
    """Advance the lag of every sensor by a step of ``dt`` s, with the present true values as input."""
    prepare_lags(mem, par, dt)
    move_lags(mem, par, values)


@compiled
def move_lags(mem: Any, par: Any, values: Any) -> None:
    """Advance the lags like `follow`. `prepare_lags` must have been called for this step and these parameters."""
    bends, twists = curves(mem)
    for k in range(SENSORS):
        output = lagged(mem, k, values[k], bends, twists)
        mem.sensor_output[k] = output if abs(output) > TINY else 0.0
        mem.sensor_input_earlier[k] = mem.sensor_input_before[k]
        mem.sensor_input_before[k] = mem.sensor_input[k]
        mem.sensor_input[k] = values[k]
    if arrives_late(par):
        place = mem.step % HISTORY
        for k in range(SENSORS):
            mem.sensor_history[k, place] = mem.sensor_output[k]


@compiled
def deliver(mem: Any, par: Any, values: Any) -> None:
    """Replace the true values of one instant by the values after the sensors' lags and delays."""
    bends, twists = curves(mem)
    for k in range(SENSORS):
        values[k] = lagged(mem, k, values[k], bends, twists)
    if arrives_late(par):
        for k in range(SENSORS):
            values[k] = delayed(mem, k, values[k], lateness(mem, par, k))


@compiled
def read_exactly(mem: Any, par: Any, values: Any, readings: Any) -> None:
    """Write readings like `read_sensors`, but without noise and quantisation. ``values`` is overwritten."""
    deliver(mem, par, values)
    express(mem, par, values, readings)


@compiled
def express(mem: Any, par: Any, values: Any, readings: Any) -> None:
    """Write the readings from values with lag and delay. Gain, offset, drift, crosstalk and range are applied; noise
    and quantisation are not.
    """
    for k in range(SENSORS):
        readings[k] = (
            (1.0 + par.sensor_gain[k]) * values[k] + par.sensor_bias[k] + par.sensor_drift[k] * mem.time
        )
    for k in range(6):
        for other in range(6):
            readings[Sensor.LOAD_CELL_1 + k] += (
                par.load_cell_crosstalk[k, other] * values[Sensor.LOAD_CELL_1 + other]
            )
    for k in range(SENSORS):
        readings[k] = min(max(readings[k], par.sensor_low[k]), par.sensor_high[k])


@compiled
def one_reading(mem: Any, par: Any, values: Any, counter: int, k: int) -> float:
    """Return the reading of sensor ``k`` from ``values`` with lag and delay. ``counter`` determines the noise."""
    s = (1.0 + par.sensor_gain[k]) * values[k] + par.sensor_bias[k] + par.sensor_drift[k] * mem.time
    if Sensor.LOAD_CELL_1 <= k <= Sensor.LOAD_CELL_6:
        for other in range(6):
            s += par.load_cell_crosstalk[k - Sensor.LOAD_CELL_1, other] * values[Sensor.LOAD_CELL_1 + other]
    if par.sensor_noise[k] > 0.0:
        s += par.sensor_noise[k] * normal(mem.seed, counter, k)
    step = par.sensor_resolution[k]
    if step > 0.0:
        s = step * floor(s / step + 0.5)
    return min(max(s, par.sensor_low[k]), par.sensor_high[k])


@compiled_once
def read_sensors(mem: Any, par: Any, values: Any, counter: int, readings: Any) -> None:
    """Write the readings of one instant, from its true ``values``. ``values`` is overwritten. ``counter`` determines
    the noise.
    """
    deliver(mem, par, values)
    for k in range(SENSORS):
        readings[k] = one_reading(mem, par, values, counter, k)


@compiled
def read_cells(mem: Any, par: Any, counter: int, values: Any, readings: Any) -> None:
    """Write the readings of the six load cells of the last step, without a new evaluation of the plant.

    ``values`` (SENSORS) is working memory. In ``readings`` (SENSORS) only those of the load cells are written.
    """
    late = arrives_late(par)
    for k in range(Sensor.LOAD_CELL_1, Sensor.LOAD_CELL_6 + 1):
        values[k] = mem.sensor_output[k]
        if late:  # the latest stored output is that of the previous step
            values[k] = delayed(mem, k, values[k], lateness(mem, par, k) + mem.lag_step)
    for k in range(Sensor.LOAD_CELL_1, Sensor.LOAD_CELL_6 + 1):
        readings[k] = one_reading(mem, par, values, counter, k)
