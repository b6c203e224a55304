"""The commanded motion of a stretch as arrays over time, computed before the bench performs it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import Final

import numpy as np

from bench_protocol.units import Hz, s
from bench_protocol.words import SIDES
from test_plans.analysis import Samples
from test_plans.analysis.geometry import ACTUATORS, LASERS, Rig
from test_plans.programmes.motions import (
    REST_AFTER,
    REST_BEFORE,
    REST_BETWEEN,
    RestPose,
    Segment,
    Stretch,
    Valves,
    Wave,
)
from test_plans.steps.poses import POSE_SETTLE

RATE: Final = 200 * Hz
#: Time from the start order of a wave until the plan detects its end: cycles of commands and of polling.
GENERATOR_LATE: Final = 0.01 * s
AXES: Final = ("vertical_left", "vertical_right", "lateral", "platform_roll")


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Set-points over time, each (n,) in m or rad, relative to design height. The valves (``leveling``, ``reservoirs``,
    ``dpv``) are 0 or 1.
    """

    time: Samples
    vertical_left: Samples
    vertical_right: Samples
    lateral: Samples
    platform_roll: Samples
    leveling: Samples
    reservoirs: Samples
    dpv: Samples
    conditioned: float  #: s, time after which friction no longer depends on earlier motion
    marks: tuple[tuple[str, float], ...]  #: name and beginning (s) of each segment
    rig: Rig  #: its dimensions

    @property
    def heights(self) -> dict[str, Samples]:
        """Heights of the springs at the lasers (m, (n,)), by side."""
        left, right = (self.rig[one] for one in ACTUATORS)
        middle = (right * self.vertical_left - left * self.vertical_right) / (right - left)
        roll = self._bolster_roll - self.platform_roll
        return {side: middle + self.rig[place] * roll for side, place in zip(SIDES, LASERS, strict=True)}

    @property
    def _bolster_roll(self) -> Samples:
        left, right = (self.rig[one] for one in ACTUATORS)
        return (self.vertical_left - self.vertical_right) / (left - right)

    @property
    def shear(self) -> Samples:
        """Lateral displacement (m, (n,)) of the top plates relative to the platform, if the bench is rigid."""
        above = self.rig["centre_height"] + self.rig["lateral_actuator_height"]
        return self.lateral + above * self._bolster_roll + self.rig["column_height"] * self.platform_roll


def trajectory(stretch: Stretch, rig: Rig, rate: float = RATE) -> Trajectory:
    """Return the motion that ``stretch`` commands on a ``rig``, sampled at ``rate`` (Hz)."""
    walk = _Walk(rate, rig, stretch.start, stretch.valves)
    walk.rest(REST_BEFORE)
    for wave in stretch.condition:
        walk.add(wave)
    conditioned = walk.samples / rate
    walk.rest(REST_BETWEEN)
    for segment in stretch.segments:
        walk.add(segment)
    walk.rest(REST_AFTER)
    left, right, lateral, roll = np.concatenate(walk.pieces, axis=1)
    leveling, reservoirs, dpv = np.concatenate(walk.switches, axis=1)
    return Trajectory(
        np.arange(left.size) / rate,
        left,
        right,
        lateral,
        roll,
        leveling,
        reservoirs,
        dpv,
        conditioned,
        tuple(walk.marks),
        rig,
    )


def unit_wave(wave: Wave, time: Samples) -> Samples:
    """Return the generator's wave of amplitude 1 at ``time`` (s) from its start, faded in and out over one cycle."""
    phase = np.minimum(time * wave.frequency, wave.cycles)
    edge = np.clip(np.minimum(phase, wave.cycles - phase), 0.0, 1.0)
    envelope = 0.5 * (1.0 - np.cos(np.pi * edge))
    if wave.form == "sine":
        return np.asarray(envelope * np.sin(2 * np.pi * phase))
    return np.asarray(envelope * (1.0 - 4.0 * np.abs((phase + 0.25) % 1.0 - 0.5)))


class _Walk:
    """Builds the motion of a stretch segment by segment from the present set-points and valves."""

    def __init__(self, rate: float, rig: Rig, start: RestPose, valves: Valves) -> None:
        self.rate, self.rig = rate, rig
        place = start.targets(rig)
        self.place = np.array([place[axis] for axis in AXES])
        self.valves = valves
        self.samples = 0
        self.pieces: list[Samples] = []
        self.switches: list[Samples] = []
        self.marks: list[tuple[str, float]] = []

    def add(self, segment: Segment) -> None:
        """Append the motion of one segment."""
        self.marks.append((segment.name, self.samples / self.rate))
        match segment:
            case Wave():
                self._wave(segment)
            case RestPose():
                self._append_move(segment)
            case Valves():
                given = {
                    name: value
                    for name in ("air", "reservoirs", "dpv")
                    if (value := getattr(segment, name)) is not None
                }
                self.valves = replace(self.valves, **given)

    def rest(self, duration: float) -> None:
        """Append ``duration`` s without motion."""
        count = round(duration * self.rate)
        self._append(np.repeat(self.place[:, None], count, axis=1))

    def _wave(self, wave: Wave) -> None:
        time = np.arange(ceil(wave.duration * self.rate)) / self.rate
        value = wave.amplitude * unit_wave(wave, time)
        tilted = (*(self.rig[one] for one in ACTUATORS), 0.0, 0.0)
        share = {"vertical": (1.0, 1.0, 0.0, 0.0), "lateral": (0.0, 0.0, 1.0, 0.0), "roll": tilted}
        self._append(self.place[:, None] + np.outer(share[wave.axis], value))
        self.rest(GENERATOR_LATE)

    def _append_move(self, pose: RestPose) -> None:
        targets = pose.targets(self.rig)
        end = np.array([targets[axis] for axis in AXES])
        duration = pose.duration_from(dict(zip(AXES, self.place.tolist(), strict=True)), self.rig)
        count = ceil(duration * self.rate)
        way = np.arange(count) / max(count, 1)
        self._append(self.place[:, None] + np.outer(end - self.place, way))
        self.place = end
        self.rest(POSE_SETTLE + pose.rest)

    def _append(self, piece: Samples) -> None:
        count = piece.shape[1]
        state = (self.valves.air == "level", self.valves.reservoirs == "on", self.valves.dpv == "on")
        self.pieces.append(piece)
        self.switches.append(np.repeat(np.array(state, dtype=float)[:, None], count, axis=1))
        self.samples += count
