"""One step of the whole bench against scipy's LSODA, at equal accuracy on the same derivative."""

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from astb_studies.benchmarks.measure import Effort, Section, compare, cpu, interleaved
from bench_protocol.arrays import Floats
from bench_protocol.runtime.binding import bind
from bench_protocol.units import Hz, mm, ms, s
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.compiled import compiled_entry
from bench_sim.model.experiments import VERTICAL, ImposedMotion, Shape, impose, isolate, place_bolster
from bench_sim.model.kernel import evaluate
from bench_sim.model.layout import STATES, State
from bench_sim.model.plant import Plant
from bench_sim.model.runge_kutta import integrated_states
from bench_sim.parameters import load

STEP = 1 * ms
DURATION = 3 * s
SAMPLE = 10 * ms
STEPS = round(DURATION / STEP)
#: Number of ticks, each with a restart of LSODA, that are timed.
TICKS = 50
SINE = ImposedMotion(VERTICAL, 5 * mm, 1 * Hz)
#: Friction reverses inside the step, which an outer integrator cannot follow, so both sides omit it.
FRICTIONLESS = {"friction_vertical": 0.0, "friction_lateral": 0.0, "friction_lateral_slope": 0.0}
#: The imposed states are no integrator's work.
IMPOSED = range(State.BOLSTER_LATERAL, State.PLATFORM_LATERAL)


@compiled_entry
def slope(
    t: float, y: Any, memory: Any, u: Any, parameters: Any, motion: Any, x: Any, dx: Any, out: Any
) -> None:
    """dx/dt of the bench with its bolster moved by ``motion``; ``x`` and ``out`` are working arrays."""
    mem = memory[0]
    mem.time = t
    x[: y.size] = y
    place_bolster(t, motion, x)
    evaluate(0.0, x, mem, u, parameters[0], (), dx, out)
    dx[State.BOLSTER_LATERAL : State.PLATFORM_LATERAL] = 0.0
    # A good first guess for Newton's method, as the fixed step has it.
    mem.solved_time = t
    for i in range(2):
        mem.bellows_vertical[i] = out[Algebraic.BELLOWS_VERTICAL + i]
        mem.bellows_lateral[i] = out[Algebraic.BELLOWS_LATERAL + i]
        mem.bellows_vertical_speed[i] = out[Algebraic.BELLOWS_VERTICAL_SPEED + i]
        mem.bellows_lateral_speed[i] = out[Algebraic.BELLOWS_LATERAL_SPEED + i]


class Outside:
    """The same run, integrated by scipy."""

    def __init__(self, plant: Plant) -> None:
        self.count = integrated_states(plant.parameters)
        self.start = plant.state[: self.count].copy()
        self.times = np.arange(round(DURATION / SAMPLE)) * SAMPLE
        motion = np.zeros((3, 5))
        motion[:, 3] = 1.0
        motion[VERTICAL] = Shape.SINE, 0.0, SINE.amplitude, SINE.frequency, 0.0
        work = plant.state.copy(), np.zeros(STATES), np.empty(ALGEBRAICS)
        arguments = plant.memory_array, plant.inputs, plant.parameter_array, motion, *work
        compiled = bind(slope, 0.0, self.start, *arguments)
        dx = work[1]

        def derivative(t: float, y: Floats) -> Floats:
            compiled(t, y, *arguments)
            return dx[: self.count].copy()

        self.derivative = derivative

    def solve(self, method: str, rtol: float, atol: Any) -> Any:
        """Return scipy's solution at the common instants."""
        options = {"method": method, "rtol": rtol, "atol": atol, "t_eval": self.times}
        found = solve_ivp(self.derivative, (0.0, DURATION), self.start, **options)
        if not found.success:
            raise RuntimeError(f"{method} with rtol = {rtol:.1e}: {found.message}")
        return found

    def tick_by_tick(self, rtol: float, atol: Any, ticks: int) -> None:
        """Restart LSODA at every tick, because inputs and latches change there."""
        state = self.start
        for n in range(ticks):
            span = n * STEP, (n + 1) * STEP
            state = solve_ivp(self.derivative, span, state, method="LSODA", rtol=rtol, atol=atol).y[:, -1]


def run(effort: Effort) -> Section:
    """Find the tolerance with which LSODA is as good as the fixed step, then measure both."""
    plant = resting()
    outside = Outside(resting())
    reference = outside.solve("DOP853", 1e-11, 1e-12 * (np.abs(outside.start) + 1e-3)).y.T
    swing = np.ptp(reference, axis=0)
    integrated = [k for k in range(outside.count) if k not in IMPOSED]
    moving = [k for k in integrated if swing[k] > 1e-7 * np.max(np.abs(reference[:, k]))]

    def error(states: Floats) -> float:
        return float(np.max(np.abs(states[:, moving] - reference[:, moving]) / swing[moving]))

    ours = error(impose(plant, [SINE], DURATION, every=round(SAMPLE / STEP)).states)
    floor = np.where(swing > 0.0, swing, np.abs(outside.start) + 1e-3)
    rtol, theirs, evaluations = 3e-2, np.inf, 0
    while theirs > ours:
        rtol /= 1.5
        found = outside.solve("LSODA", rtol, rtol * floor)
        theirs, evaluations = error(found.y.T), found.nfev

    found = interleaved(
        effort.repetitions,
        {
            "fixed": lambda: cpu(lambda: impose(plant, [SINE], DURATION, rows=0), STEPS),
            "lsoda": lambda: cpu(lambda: outside.solve("LSODA", rtol, rtol * floor), STEPS),
            "ticks": lambda: cpu(lambda: outside.tick_by_tick(rtol, rtol * floor, TICKS), TICKS),
        },
    )
    met = float(np.median(found["fixed"])) <= 1.5e-6
    rows = (
        compare(
            "one step of 1 ms, whole bench",
            found["fixed"],
            "LSODA, restarted every tick",
            found["ticks"],
            aim="at most 1.5 µs",
            met=met,
        ),
        compare(
            "1 ms of an undisturbed run", found["fixed"], "LSODA, free to choose its steps", found["lsoda"]
        ),
    )
    notes = (
        f"Vertical sine of 5 mm at 1 Hz for {DURATION:g} s, AW0, without friction; {len(moving)} of "
        f"{outside.count} states move. Largest error over the swing of its state, against DOP853 at rtol = 1e-11: "
        f"fixed step {ours:.1e}, LSODA {theirs:.1e} with rtol = {rtol:.1e}, for which it asks for the derivative "
        f"{evaluations / DURATION:.0f} times a second (the fixed step {4 / STEP:.0f} times).",
        "The derivative is compiled in all; scipy's solve_ivp calls it from Python. A rig changes its inputs, its "
        "latches and the direction of its friction at any tick, where a solver with a memory has to restart. "
        "Processor time of one thread.",
    )
    return Section("One step of the model", rows, notes)


def resting() -> Plant:
    """Return the bench under AW0 with its valves closed."""
    plant = Plant.at_rest(load("astb").under("AW0").with_values(**FRICTIONLESS).record, dt=STEP)
    isolate(plant)
    return plant
