"""The named steps of the test instructions: raise the air, level, shake, roll, let the air off."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from math import tau
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import numpy.typing as npt

from bench_protocol.table import PROGRAM_STATES, SIDES
from bench_protocol.units import ATMOSPHERE, NS, Hz, K, bar, kN, minutes, mm, ms, s
from drivers.errors import RigFault
from test_plans.analysis import (
    Samples,
    Stiffness,
    dynamic_stiffness,
    first_harmonic,
    loop_energy,
    secant_stiffness,
    straight_line,
    whole_cycles,
    without_drift,
    without_inertia,
)
from test_plans.loads import (
    AUXILIARY_VOLUME,
    BELLOWS_VOLUME,
    BOLSTER_MASS,
    EFFECTIVE_AREA,
    EFFECTIVE_AREA_SLOPE,
    EMERGENCY_STIFFNESS,
    PRELOAD_TOLERANCE,
    REST_HEIGHT,
    Band,
    Load,
)

if TYPE_CHECKING:
    from drivers.receiver import Capture
    from test_plans.run import Run

# -- what the instruction says of time and travel --------------------------------------------------------------------

ARM_WITHIN: Final = 10 * s
LIFT_RATE: Final = 40 * mm / s
FILL_WITHIN: Final = 60 * s
#: The valves close in proportion over the last 0.15 bar below their target.
FILL_BEYOND: Final = 0.15 * bar
PRELOAD_RATE: Final = 20 * kN / s
PRELOAD_WITHIN: Final = 10 * s
#: Leveled: both heights within the dead zone of their valves for so long.
LEVEL_STEADY: Final = 1 * s
LEVEL_WITHIN: Final = 20 * s
#: Settled: the gas still cools after filling, but slower than this. What remains moves no result by 2 %.
SETTLE_BAND: Final = 2.0 * K
SETTLE_WITHIN: Final = 30 * s
AVERAGE_OVER: Final = 1 * s
KEEP_AVERAGE: Final = 0.4 * s
KEEP_TOLERANCE: Final = 0.1 * bar

AMPLITUDE: Final = 5 * mm
#: Slow: below it, a vertical spring loses little through its orifice; above 0.1 Hz, little through its walls.
LOOP_FREQUENCY: Final = 0.3 * Hz
#: The generator fades in over its first cycle and out over its last: what lies between is measured.
CYCLES: Final = {LOOP_FREQUENCY: 3, 0.5 * Hz: 3, 1.0 * Hz: 4, 2.0 * Hz: 5, 3.0 * Hz: 7}
SAMPLE_RATE: Final = 200 * Hz
#: Data sheets: the lasers are 2 ms late, load cells and transducers of the actuators 1 ms.
LASER_LAG: Final = 2 * ms
LOAD_CELL_LAG: Final = 1 * ms
TRANSDUCER_LAG: Final = 1 * ms

TRACK_FREQUENCY: Final = 1.2 * Hz
TRACK_CYCLES: Final = 3
#: Under constant force each spring carries 600 kg of bolster, which follow the track by K / (K - m ω²): 1.08 (AW0) and
#: 1.05 (AW3) with the stiffness of 450 and 770 kN/m that a spring has at the few tenths of a millimetre it gives here.
TRACK_TRANSMISSIBILITY: Final = Band(1.02, 1.12)
#: 5 mm times the same, less or more by the bolster's own motion at 4 to 6 Hz when it is set off.
TRACK_PEAK: Final = Band(4.8 * mm, 5.8 * mm)

LATERAL_RATE: Final = 2 * kN / s
#: The differential pressure valve opens at 1.2 bar: rolling stays below, or air would change sides.
ROLL_PRESSURE_MAX: Final = 1.0 * bar
ROLL_RATE: Final = 20 * kN / s
ROLL_WAIT: Final = 1.5 * s
ROLL_AVERAGE: Final = 0.5 * s
SPRING_HALF_SPACING: Final = 1.0

#: Chain of measurement: load cells against actuators, each good for 1 % of the force that a shaken spring makes.
BALANCE_TOLERANCE: Final = 0.04
#: A tight spring keeps its air. Over half a minute transducers and thermometers resolve 0.05 %; the smallest leak that
#: matters (5e-11 m³/(s Pa)) loses 0.3 % a minute.
AIR_LOSS_MAX: Final = 0.002
THERMOMETER_LAG: Final = 1 * s

#: What counts as depressurised: too little to lift the bolster (0.23 bar).
RESIDUAL_PRESSURE: Final = 0.2 * bar
VENT_WITHIN: Final = 3 * minutes

#: Vertical load cells under each spring: they stand below the springs, 1 m to either side.
CELLS: Final = {"left": (1, 3), "right": (2, 4)}
LIVE: Final = ("AIR_LOW", "AIR_HIGH", "HOLD", "ACTIVE")


# -- up and down -------------------------------------------------------------------------------------------------------


def power_up(run: Run) -> None:
    """Bring the bench to ACTIVE."""
    with run.phase("power up"):
        run.bench.arm(within=ARM_WITHIN)


def make_safe(run: Run) -> None:
    """Stop the generator, let the air off, disarm: each even if the one before could not be done."""
    with ExitStack() as last_first:
        last_first.callback(run.bench.disarm)
        last_first.callback(depressurise, run)
        last_first.callback(run.bench.generator.stop)


def depressurise(run: Run) -> None:
    """Let the air out of both springs under their load, so that nothing jumps.

    RigFault if the bench shut its valves in a fault: then somebody has to look, reset and vent.
    """
    bench = run.bench

    def empty() -> bool:
        return max(bench.left.bellows_pressure, bench.right.bellows_pressure) <= RESIDUAL_PRESSURE

    with run.phase("depressurise"):
        if bench.rig.state in LIVE:
            if bench.vertical.control != "force":
                bench.vertical.control = "force"
            bench.air.vent(tolerance=RESIDUAL_PRESSURE, within=VENT_WITHIN)
        elif bench.rig.state == "ESTOP":
            with bench.despite_faults():  # the stop itself lets the air off
                bench.wait_for(empty, within=VENT_WITHIN, what="both springs without air")
        elif not empty():
            raise RigFault(f"the springs keep their air, for the bench shut its valves: {bench.describe()}")


def carry(load: Load) -> Callable[[Run], None]:
    """Return the set-up that lets both springs carry ``load`` on their leveling valves."""

    def set_up(run: Run) -> None:
        shim(run, load)
        power_up(run)
        raise_the_air(run, load)
        level_to_the_preload(run, load)

    return set_up


def shim(run: Run, load: Load) -> None:
    """Set the height to zero for this load: the emergency springs give 15 mm between the empty and the full car."""
    with run.phase("shim"):
        run.bench.rig.nominal_preload = load.preload


def raise_the_air(run: Run, load: Load) -> None:
    """Lift the bolster to design height and fill both springs to the pressure that will carry the load."""
    bench = run.bench
    with run.phase("raise the air"):
        # At design height from the start, the springs need no more travel when they take the load over.
        bench.vertical.move_to(0.0, 0.0, rate=LIFT_RATE)
        # Aim beyond and stop on the way: the leveling valves do the rest anyway.
        bench.air.fill(to=load.fill_pressure + FILL_BEYOND, tolerance=FILL_BEYOND, within=FILL_WITHIN)


def level_to_the_preload(run: Run, load: Load) -> None:
    """Hand the springs to their leveling valves, load them, and let the gas come near the temperature of the walls."""
    bench = run.bench
    with run.phase("level to the preload"):
        bench.air.level()
        force = load.actuator_force
        bench.vertical.preload(force, force, rate=PRELOAD_RATE, within=PRELOAD_WITHIN)
        bench.wait_for(
            lambda: all(_inside(height, REST_HEIGHT) for height in (bench.left.height, bench.right.height)),
            within=LEVEL_WITHIN,
            what="both springs leveled",
            steady=LEVEL_STEADY,
        )
    with run.phase("settle"):
        gas = [f"{side}.{chamber}_temperature" for side in SIDES for chamber in ("bellows", "auxiliary")]
        bench.settle(*gas, band=SETTLE_BAND, over=AVERAGE_OVER, within=SETTLE_WITHIN)


def hold_the_height(run: Run) -> None:
    """Hold the bolster where the leveling valves brought it, and replace the pressure that cooling takes."""
    bench = run.bench
    with run.phase("hold the height"):
        bench.vertical.hold_position()
        bench.lateral.hold_position()
        # The valves follow the transducers of the auxiliary chambers: each side keeps what its own one reads.
        names = [f"{side}.auxiliary_pressure" for side in SIDES]
        left, right = bench.averages(*names, over=KEEP_AVERAGE).values()
        bench.air.fill(left=left, right=right, tolerance=KEEP_TOLERANCE)


def lock_the_air(run: Run) -> None:
    """Shut all valves: from here on the springs keep the air they have."""
    with run.phase("lock the air"):
        run.bench.air.hold()


def check_air(run: Run, load: Load) -> None:
    """Check load, height and pressure of each spring at rest on its leveling valve."""
    with run.phase("static pressure"):
        states = [f"{side}.{what}" for side in SIDES for what in ("height", "bellows_pressure")]
        mean = run.bench.averages(*_CELLS, *states, over=AVERAGE_OVER)
        for side in SIDES:
            carried = sum(mean[f"load_cell.{cell}"] for cell in CELLS[side])
            low, high = load.preload - PRELOAD_TOLERANCE, load.preload + PRELOAD_TOLERANCE
            run.check(f"load on the {side} spring", carried, "kN", low=low, high=high)
            _check(run, f"height of the {side} spring", mean[f"{side}.height"], "mm", REST_HEIGHT)
            _check(
                run, f"pressure in the {side} bellows", mean[f"{side}.bellows_pressure"], "bar", load.pressure
            )


# -- vertical ----------------------------------------------------------------------------------------------------------


def vertical_loop(run: Run, load: Load) -> None:
    """Measure the quasi-static vertical stiffness of each spring: a slow triangle of 5 mm to either side."""
    with run.phase("vertical triangle"):
        _, values = _shake(run, "vertical", LOOP_FREQUENCY, _VERTICAL, "triangle")
        for side in SIDES:
            motion, force = _spring_motion(values, side)
            _check_secant(run, f"{side} vertical stiffness, slow", motion, force, load.vertical_secant)
            _keep_loop(run, "slow", f"{side} spring", motion, force)


def vertical_sweep(run: Run, load: Load) -> None:
    """Measure vertical stiffness and damping of each spring, first harmonic, 5 mm."""
    found: dict[str, list[Stiffness]] = {side: [] for side in SIDES}
    for frequency, (storage, damping) in load.vertical.items():
        with run.phase(f"vertical sine {frequency:g} Hz"):
            times, values = _shake(run, "vertical", frequency, _VERTICAL)
            for side in SIDES:
                motion, force = _spring_motion(values, side)
                K = dynamic_stiffness(times, motion, force, frequency, motion_lag=LASER_LAG - LOAD_CELL_LAG)
                found[side].append(K)
                _check(run, f"{side} vertical K' at {frequency:g} Hz", K.storage, "kN/m", storage)
                _check(run, f"{side} vertical c at {frequency:g} Hz", K.damping, "kN*s/m", damping)
                one = times < times[0] + 1 / frequency
                _keep_loop(run, f"{frequency:g} Hz", f"{side} spring", motion[one], force[one])
            if frequency == max(load.vertical):
                _check_balance(run, times, values, frequency)
    for side in SIDES:
        _keep_sweep(run, f"{side} spring", "vertical", found[side])


def _check_balance(run: Run, times: Samples, values: dict[str, Samples], frequency: float) -> None:
    """Compare load cells with actuators, which also move the bolster: ΣF_cells = ΣF_act − m ẍ (downward)."""
    actuators = values["vertical_left.force"] + values["vertical_right.force"]
    motion = -0.5 * (values["left.height"] + values["right.height"])
    cells = np.sum([values[cell] for cell in _CELLS], axis=0)
    x = first_harmonic(times, motion, frequency) * (1 + 1j * tau * frequency * LASER_LAG)
    F = first_harmonic(times, actuators, frequency) * (1 + 1j * tau * frequency * TRANSDUCER_LAG)
    S = first_harmonic(times, cells, frequency) * (1 + 1j * tau * frequency * LOAD_CELL_LAG)
    ratio = abs(without_inertia(F, x, BOLSTER_MASS, frequency) / S)
    run.check(
        f"actuators without inertia over load cells at {frequency:g} Hz",
        ratio,
        "1",
        low=1 - BALANCE_TOLERANCE,
        high=1 + BALANCE_TOLERANCE,
    )


# -- lateral -----------------------------------------------------------------------------------------------------------


def lateral_loop(run: Run, load: Load) -> None:
    """Measure the quasi-static lateral stiffness of the pair: a slow triangle of 5 mm to either side."""
    with run.phase("lateral triangle"):
        _, values = _shake(run, "lateral", LOOP_FREQUENCY, _LATERAL, "triangle")
        motion, force = _lateral_motion(values)
        _check_secant(run, "lateral stiffness, slow", motion, force, load.lateral_secant)
        _keep_loop(run, "slow", "lateral", motion, force)


def lateral_sweep(run: Run, load: Load) -> None:
    """Measure lateral stiffness and damping of the pair, first harmonic, 5 mm."""
    found: list[Stiffness] = []
    for frequency, (storage, damping) in load.lateral.items():
        with run.phase(f"lateral sine {frequency:g} Hz"):
            times, values = _shake(run, "lateral", frequency, _LATERAL)
            motion, force = _lateral_motion(values)
            K = dynamic_stiffness(times, motion, force, frequency, motion_lag=TRANSDUCER_LAG - LOAD_CELL_LAG)
            found.append(K)
            _check(run, f"lateral K' at {frequency:g} Hz", K.storage, "kN/m", storage)
            _check(run, f"lateral c at {frequency:g} Hz", K.damping, "kN*s/m", damping)
            one = times < times[0] + 1 / frequency
            _keep_loop(run, f"{frequency:g} Hz", "lateral", motion[one], force[one])
    _keep_sweep(run, "pair", "lateral", found)


# -- track and roll ----------------------------------------------------------------------------------------------------


def free_the_bolster(run: Run) -> None:
    """Let the actuators press with constant force instead of holding the position."""
    bench = run.bench
    with run.phase("free the bolster"):
        bench.vertical.control = "force"
        bench.lateral.push(0.0, rate=LATERAL_RATE)


def track_excitation(run: Run) -> None:
    """Move the platform as a track would, a unilateral cosine of 5 mm, under constant preload; look at the bolster."""
    bench = run.bench
    with run.phase("unilateral cosine"):
        with bench.capture("left.height", "right.height", "platform.vertical", *_GENERATOR) as capture:
            bench.generator.run(
                "platform_vertical",
                "unilateral_cosine",
                amplitude=AMPLITUDE,
                frequency=TRACK_FREQUENCY,
                cycles=TRACK_CYCLES,
            )
        times, values = capture.aligned(SAMPLE_RATE)
        platform = values["platform.vertical"] - values["platform.vertical"][0]
        spring = 0.5 * (values["left.height"] + values["right.height"])
        bolster = platform + spring - spring[0]
        steady = _cycles(times, values, 1, TRACK_CYCLES - 1, TRACK_FREQUENCY)
        response = first_harmonic(times[steady], bolster[steady], TRACK_FREQUENCY)
        excitation = first_harmonic(times[steady], platform[steady], TRACK_FREQUENCY)
        _check(
            run, "bolster over platform at 1.2 Hz", abs(response / excitation), "1", TRACK_TRANSMISSIBILITY
        )
        _check(run, "peak of the bolster", float(bolster.max()), "mm", TRACK_PEAK)


def roll_by_unequal_preload(run: Run, load: Load) -> None:
    """Load the two sides unequally, first the left more, then the right; the air stays locked."""
    bench = run.bench
    with run.phase("roll"):
        names = [f"{side}.{what}" for side in SIDES for what in ("height", "bellows_pressure")]
        names += [f"vertical_{side}.force" for side in SIDES]
        # Differences between the two rolls: what a transducer is off by falls out.
        moments, angles, differences = [], [], []
        for more in (load.roll_load, -load.roll_load):
            force = load.actuator_force
            bench.vertical.preload(force + more, force - more, rate=ROLL_RATE, within=PRELOAD_WITHIN)
            bench.wait(ROLL_WAIT)
            mean = bench.averages(*names, over=ROLL_AVERAGE)
            moments.append(SPRING_HALF_SPACING * (mean["vertical_right.force"] - mean["vertical_left.force"]))
            angles.append((mean["left.height"] - mean["right.height"]) / (2 * SPRING_HALF_SPACING))
            differences.append(mean["left.bellows_pressure"] - mean["right.bellows_pressure"])
        bench.vertical.preload(
            load.actuator_force, load.actuator_force, rate=ROLL_RATE, within=PRELOAD_WITHIN
        )
        stiffness = (moments[1] - moments[0]) / (angles[1] - angles[0])
        _check(run, "roll stiffness", stiffness, "kN*m/rad", load.roll_stiffness)
        swing = 0.5 * (differences[0] - differences[1])
        run.check("pressure difference by rolling", swing, "bar", high=ROLL_PRESSURE_MAX)


# -- tightness ---------------------------------------------------------------------------------------------------------


def weigh_the_air(run: Run) -> dict[str, float]:
    """Read what tells the mass of air in each spring; give it to `check_tightness` some time later.

    A thermometer that follows with first order reads what was: T = T_read + τ dT_read/dt.
    """
    with run.phase("weigh the air"):
        gas = [f"{side}.{part}_{what}" for side in SIDES for part in _CHAMBERS for what in _GAS]
        heights = [f"{side}.height" for side in SIDES]
        with run.bench.capture(*gas, *heights, *_CELLS) as capture:
            run.bench.wait(AVERAGE_OVER)
        state = {"time": run.now / NS}
        for name in capture.names:
            level, slope = straight_line(capture.times(name), capture.values(name))
            state[name] = level + THERMOMETER_LAG * slope if name.endswith("temperature") else level
        return state


def check_tightness(run: Run, load: Load, before: dict[str, float]) -> None:
    """Check that each spring kept its air since ``before``: m = Σ pV/(RT), whatever the temperature did meanwhile."""
    after = weigh_the_air(run)
    elapsed = after["time"] - before["time"]
    for side in SIDES:
        lost = 1 - _air(after, load, side) / _air(before, load, side)
        run.check(f"air lost per minute, {side} spring", lost * minutes / elapsed, "%", high=AIR_LOSS_MAX)


_CHAMBERS: Final = ("bellows", "auxiliary")
_GAS: Final = ("pressure", "temperature")


def _air(state: dict[str, float], load: Load, side: str) -> float:
    """Mass of air in both chambers of a spring, times R.

    The bellows is higher than the stack of both by what the emergency spring gives way beyond the preload.
    """
    carried = sum(state[f"load_cell.{cell}"] for cell in CELLS[side])
    height = state[f"{side}.height"] + (carried - load.preload) / EMERGENCY_STIFFNESS
    bellows = BELLOWS_VOLUME + EFFECTIVE_AREA * height + 0.5 * EFFECTIVE_AREA_SLOPE * height**2
    return sum(
        (state[f"{side}.{part}_pressure"] + ATMOSPHERE) * volume / state[f"{side}.{part}_temperature"]
        for part, volume in zip(_CHAMBERS, (bellows, AUXILIARY_VOLUME), strict=True)
    )


# -- common ------------------------------------------------------------------------------------------------------------

_GENERATOR: Final = ("rig.program", "rig.generator_cycle")
_CELLS: Final = tuple(f"load_cell.{cell}" for pair in CELLS.values() for cell in pair)
_VERTICAL: Final = (
    *(f"{side}.height" for side in SIDES),
    *_CELLS,
    *(f"vertical_{side}.force" for side in SIDES),
    *_GENERATOR,
)
_LATERAL: Final = ("lateral.displacement", "load_cell.5", "load_cell.6", *_GENERATOR)


def _shake(
    run: Run,
    axis: Literal["vertical", "lateral"],
    frequency: float,
    names: tuple[str, ...],
    wave: Literal["sine", "triangle"] = "sine",
) -> tuple[Samples, dict[str, Samples]]:
    """Run a wave of 5 mm and return the aligned samples of its whole cycles at full amplitude."""
    cycles = CYCLES[frequency]
    with run.bench.capture(*names) as capture:
        run.bench.generator.run(axis, wave, amplitude=AMPLITUDE, frequency=frequency, cycles=cycles)
    return _at_full_amplitude(capture, frequency, cycles)


def _at_full_amplitude(capture: Capture, frequency: float, cycles: int) -> tuple[Samples, dict[str, Samples]]:
    times, values = capture.aligned(SAMPLE_RATE)
    steady = _cycles(times, values, 1, cycles - 2, frequency)
    return times[steady], {name: series[steady] for name, series in values.items()}


def _cycles(
    times: Samples, values: dict[str, Samples], first: int, count: int, frequency: float
) -> npt.NDArray[np.bool_]:
    running = values["rig.program"] == PROGRAM_STATES.index("RUN")
    return whole_cycles(
        times, values["rig.generator_cycle"], running, first=first, count=count, frequency=frequency
    )


def _spring_motion(values: dict[str, Samples], side: str) -> tuple[Samples, Samples]:
    """Compression of a spring (m) and the force on it (N), both growing downward."""
    first, second = CELLS[side]
    return -values[f"{side}.height"], values[f"load_cell.{first}"] + values[f"load_cell.{second}"]


def _lateral_motion(values: dict[str, Samples]) -> tuple[Samples, Samples]:
    """Displacement of the bolster (m) and the force that the springs oppose to it (N)."""
    return values["lateral.displacement"], -(values["load_cell.5"] + values["load_cell.6"])


def _check(run: Run, name: str, value: float, unit: str, band: Band) -> None:
    run.check(name, value, unit, low=band.low, high=band.high)


def _check_secant(run: Run, name: str, motion: Samples, force: Samples, band: Band) -> None:
    force = without_drift(motion, force)  # the gas cools while a slow loop lasts
    lost = f"{loop_energy(motion, force):.2f} J lost in the loop"
    run.check(name, secant_stiffness(motion, force), "kN/m", low=band.low, high=band.high, note=lost)


def _inside(value: float, band: Band) -> bool:
    return band.low <= value <= band.high


def _keep_loop(run: Run, name: str, what: str, motion: Samples, force: Samples) -> None:
    from bench_records.result import Axis

    run.loop(
        name,
        Axis("displacement", "mm", mm),
        Axis("force", "kN", kN),
        motion - motion.mean(),
        force - force.mean(),
        group=f"{what.capitalize()}: force over displacement",
    )


def _keep_sweep(run: Run, name: str, direction: str, found: list[Stiffness]) -> None:
    from bench_records.result import Axis

    frequencies = [one.frequency for one in found]
    for what, unit, values in (
        ("stiffness K'", "kN/m", [one.storage for one in found]),
        ("damping c", "kN*s/m", [one.damping for one in found]),
    ):
        run.curve(
            name,
            Axis("frequency", "Hz"),
            Axis(what, unit, kN),
            frequencies,
            values,
            group=f"{direction.capitalize()} {what}",
        )
