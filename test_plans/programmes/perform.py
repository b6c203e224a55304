"""Execution of motions on the bench. Every segment is a phase of its own, so that the record can be replayed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from inspect import cleandoc
from typing import TYPE_CHECKING, Final

import numpy as np

from bench_protocol.units import Hz, s
from drivers.errors import Refused
from test_plans import steps
from test_plans.air_left import zeros_off
from test_plans.analysis import GENERATOR, HEIGHTS, Samples
from test_plans.analysis.geometry import PLACING, POSE_SIGNALS, Rig, shear_of
from test_plans.analysis.uncertainty import counted
from test_plans.check_names import CheckName
from test_plans.description import ours
from test_plans.loads import AW0, AW3, Band
from test_plans.plan import Plan
from test_plans.programmes.motions import (
    CONDITION,
    REPLAY,
    REST,
    REST_AFTER,
    REST_BEFORE,
    REST_BETWEEN,
    Part,
    Programme,
    RestPose,
    Segment,
    Stretch,
    Valves,
    Wave,
)
from test_plans.programmes.trajectory import RATE, trajectory
from test_plans.steps.carrying import HELD_SIDEWAYS
from test_plans.steps.fittings import CONNECTIONS, leave_connected, put_down
from test_plans.steps.poses import POSE_SETTLE, Home, go_home

if TYPE_CHECKING:
    from drivers.receiver import Capture
    from test_plans.run import Run

#: Time in which the gas approaches the temperature of the walls, after filling and leveling and before the valves are
#: shut.
COOL: Final = 10 * s
#: Sampling rate (Hz) that is sufficient to compute the duration of a programme.
COARSE: Final = 10 * Hz
#: A stretch begins when the thermometers (1 s) have reached the temperature of the gas.
SETTLE: Final = 10 * s
#: From the end of one stretch to the beginning of the next, on the average.
BETWEEN: Final = SETTLE + 1 * s
#: Required share of the frames that the bench sends; the others may be lost.
RECEIVED: Final = 0.8
FEW: Final = 10
SAMPLES: Final = CheckName(
    "{name}: samples of the lasers",
    "How many of the lasers' samples were received: a model cannot replay a record with gaps.",
)
WENT: Final = CheckName(
    "{name}: way of the {what}",
    "The share of the commanded motion that was made: a diagnosis needs motion.",
)
#: Actuators follow within a few per cent; frame and emergency springs yield by a little more.
WAY: Final = Band(0.8, 1.2)

#: Time for taking up a load, and for venting at the end, in addition to the stretches.
TAKE_UP: Final = {AW0: 40 * s, AW3: 52 * s}


def lasts(programme: Programme) -> float:
    """Return how long (s) a programme takes on the virtual bench. On a rig of other dimensions the time differs
    little.
    """
    return sum(
        TAKE_UP[part.load]
        + sum(float(trajectory(stretch, ours(), COARSE).time[-1]) + BETWEEN for stretch in part.stretches)
        for part in programme.parts
    )


def programme_plan(programme: Programme) -> Plan:
    """Return the plan that performs ``programme`` on the bench. It does not judge the product."""
    instruction = f"{programme.title}\n\n{cleandoc(programme.purpose)}"
    return Plan(
        programme.name,
        programme.title,
        instruction,
        main=lambda run: perform(run, programme),
        setup=steps.carry(programme.parts[0].load),
        teardown=leave_connected,
        lasts=lasts(programme),
        judges=False,
        checks=(SAMPLES, WENT),
        needs=(
            *steps.CARRYING,
            *POSE_SIGNALS,
            *HELD_SIDEWAYS,
            "platform.roll_setpoint",
            *GENERATOR,
            *CONNECTIONS,
            *PLACING,
        ),
    )


def perform(run: Run, programme: Programme) -> None:
    """Perform ``programme``. The springs must already carry its first load."""
    number = 0
    for part in programme.parts:
        if part is not programme.parts[0] and not _taken_up(run, programme, part, number):
            return
        home = go_home(run)
        with run.phase("cool"):
            run.bench.wait(COOL)
        for stretch in part.stretches:
            number += 1
            with run.phase("prepare"):
                _set_valves(run, stretch.valves)
                _move_to_pose(run, home, stretch.start)
                run.bench.wait(SETTLE)
            name = f"{programme.name} {number} {part.load}"
            with run.phase(f"{REPLAY} {name}"):
                with run.bench.capture(*POSE_SIGNALS) as capture:
                    _stretch(run, home, stretch)
                _check(run, name, stretch, capture)
        with run.phase("back"):  # the next load is taken up level and centred
            _move_to_pose(run, home, RestPose())


def _taken_up(run: Run, programme: Programme, part: Part, number: int) -> bool:
    """Replace the present load by that of ``part``. Return False if wrong zeros of the transducers prevent it.

    In this case the motion recorded so far can still be replayed, because it may show the cause.
    """
    put_down(run)
    try:
        steps.carry(part.load)(run)
    except Refused as refused:
        if not (off := zeros_off(run.bench)):
            raise
        rest = programme.parts[programme.parts.index(part) :]
        names = [str(one.load) for one in rest for _ in one.stretches]
        missing = [
            SAMPLES.of(name=f"{programme.name} {k} {load}") for k, load in enumerate(names, number + 1)
        ]
        run.not_available(missing, f"{part.load} is not taken up: {refused}; {off}")
        return False
    return True


def _check(run: Run, name: str, stretch: Stretch, capture: Capture) -> None:
    """Check that the record can be replayed: enough samples were received, and the springs reached the commanded
    travel.

    A gap in the samples does not reduce the reached travel.
    """
    path = trajectory(stretch, run.rig)
    came = min(_received(capture.times(height), path.time[-1]) for height in HEIGHTS)
    run.check(SAMPLES.of(name=name), counted(came), "%", low=RECEIVED)
    _, values = capture.aligned(RATE)
    ways: dict[str, tuple[Callable[[Mapping[str, Samples], Rig], Samples], Samples]] = {
        **{f"{side} spring, up and down": (partial(_height, side), z) for side, z in path.heights.items()},
        "springs, sideways": (shear_of, path.shear),
    }
    for what, (of, target) in ways.items():
        if (way := float(np.ptp(target))) > 0.0:
            went = run.measured(partial(_travel_ratio, of, way), run.rig, values, rate=RATE)
            run.check(WENT.of(name=name, what=what), went, "1", low=WAY.low, high=WAY.high)


def _received(times: Samples, duration: float) -> float:
    """Return the share of a signal's samples that was received in ``duration`` (s), relative to its usual interval.

    The usual interval is the first quartile of the intervals. It is correct even if nearly every second sample is lost.
    """
    if times.size < FEW:
        return 0.0
    return float(times.size * np.quantile(np.diff(times), 0.25) / duration)


def _height(side: str, values: Mapping[str, Samples], rig: Rig) -> Samples:
    return values[f"{side}.height"]


def _travel_ratio(
    of: Callable[[Mapping[str, Samples], Rig], Samples], way: float, rig: Rig, values: Mapping[str, Samples]
) -> float:
    """Return the ratio of the measured travel to the commanded travel ``way`` (m); NaN without samples."""
    motion = of(values, rig)
    seen = motion[np.isfinite(motion)]
    return float(np.ptp(seen)) / way if seen.size else float("nan")


def _stretch(run: Run, home: Home, stretch: Stretch) -> None:
    _wait_at_rest(run, REST_BEFORE)
    for wave in stretch.condition:
        with run.phase(f"{CONDITION} {wave.axis}"):
            _shake(run, wave)
    _wait_at_rest(run, REST_BETWEEN)
    for segment in stretch.segments:
        _segment(run, home, segment)
    _wait_at_rest(run, REST_AFTER)


def _segment(run: Run, home: Home, segment: Segment) -> None:
    with run.phase(segment.name):
        match segment:
            case Wave():
                _shake(run, segment)
            case RestPose():
                _move_to_pose(run, home, segment)
            case Valves():
                _set_valves(run, segment)
    if isinstance(segment, RestPose) and segment.rest:
        _wait_at_rest(run, segment.rest)


def _wait_at_rest(run: Run, duration: float) -> None:
    with run.phase(REST):
        run.bench.wait(duration)


def _shake(run: Run, wave: Wave) -> None:
    size = "roll_amplitude" if wave.axis == "roll" else "amplitude"
    run.bench.generator.run(
        wave.axis, wave.form, **{size: wave.amplitude}, frequency=wave.frequency, cycles=wave.cycles
    )


def _set_valves(run: Run, valves: Valves) -> None:
    air = run.bench.air
    for value, actions in (
        (valves.air, {"hold": air.hold, "level": air.level}),
        (valves.reservoirs, {"on": air.connect_reservoirs, "off": air.isolate_reservoirs}),
        (valves.dpv, {"on": air.connect_dpv, "off": air.isolate_dpv}),
    ):
        if value is not None:
            actions[value]()


def _move_to_pose(run: Run, home: Home, pose: RestPose) -> None:
    """Move all axes to a pose so that they arrive together. The axis with the longest distance moves at the rate of the
    pose.
    """
    commander = run.bench.commander
    offsets = {"vertical_left": home.left, "vertical_right": home.right}
    targets = {axis: to + offsets.get(axis, 0.0) for axis, to in pose.targets(run.rig).items()}
    setpoints = {axis: _setpoint(axis) for axis in targets}
    present = {axis: commander.value(name) for axis, name in setpoints.items()}
    duration = pose.duration_from(
        {axis: at - offsets.get(axis, 0.0) for axis, at in present.items()}, run.rig
    )
    for axis, to in targets.items():
        if (way := abs(to - present[axis])) > 0.0:
            commander.ramp(setpoints[axis], to, way / duration)
    run.bench.wait_for(
        lambda: not commander.moving(*setpoints.values()),
        within=duration + 1 * s,
        what="bolster and platform in their place",
    )
    run.bench.wait(POSE_SETTLE)


def _setpoint(axis: str) -> str:
    return "platform.roll_setpoint" if axis == "platform_roll" else f"{axis}.displacement_setpoint"
