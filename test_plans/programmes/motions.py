"""Motions of the bench as data, from which a run and its prediction are made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from bench_protocol.units import Hz, mm, mrad, s
from test_plans.analysis.geometry import Rig, lifted, pose

Axis = Literal["vertical", "lateral", "roll"]
Form = Literal["sine", "triangle"]
Switch = Literal["off", "on"]
AirMode = Literal["hold", "level"]

#: Names in a record of the motion to be replayed, of the preparation, and of the time without motion.
REPLAY: Final = "replay"
CONDITION: Final = "condition"
REST: Final = "rest"


@dataclass(frozen=True, slots=True)
class Wave:
    """Whole cycles of the function generator about the present pose. The first cycle fades in, the last one
    fades out.
    """

    axis: Axis
    amplitude: float  #: m; rad on the roll axis
    frequency: float  #: Hz
    cycles: int
    form: Form = "sine"

    @property
    def name(self) -> str:
        """The wave as text for reports."""
        size = f"{self.amplitude / mrad:g} mrad" if self.axis == "roll" else f"{self.amplitude / mm:g} mm"
        return f"{self.axis} {self.form} {size}, {self.frequency:g} Hz"

    @property
    def duration(self) -> float:
        """The duration (s)."""
        return self.cycles / self.frequency


@dataclass(frozen=True, slots=True)
class RestPose:
    """A pose of the springs, relative to the pose at design height, centred and level. The bench moves to it
    and rests.
    """

    height: float = 0.0  #: m
    shear: float = 0.0  #: m
    roll: float = 0.0  #: rad
    rate: float = 40 * mm / s  #: of the actuator with the longest way
    rest: float = 0.0  #: s

    @property
    def name(self) -> str:
        """The pose as text for reports."""
        places = (
            f"{what} {value / unit:g} {text}"
            for what, value, unit, text in (
                ("height", self.height, mm, "mm"),
                ("shear", self.shear, mm, "mm"),
                ("roll", self.roll, mrad, "mrad"),
            )
            if value
        )
        return f"go to {', '.join(places) or 'design height'}"

    def targets(self, rig: Rig) -> dict[str, float]:
        """Return by axis the set-points (m, rad) of a ``rig`` in this pose, relative to design height."""
        to = pose(rig, self.shear, self.roll)
        return {
            **{actuator: self.height + way for actuator, way in lifted(rig, to.bolster_roll).items()},
            "lateral": to.lateral,
            "platform_roll": to.platform_roll,
        }

    def duration_from(self, place: Mapping[str, float], rig: Rig) -> float:
        """Return the time (s) of the motion from the set-points ``place`` to this pose. A radian counts as a metre."""
        return max(abs(to - place[axis]) for axis, to in self.targets(rig).items()) / self.rate


@dataclass(frozen=True, slots=True)
class Valves:
    """A change of valves at rest; None leaves a valve unchanged."""

    air: AirMode | None = None  #: shut, or on the leveling valves
    reservoirs: Switch | None = None  #: auxiliary chambers joined with their bellows
    dpv: Switch | None = None  #: differential pressure valve between the sides

    @property
    def name(self) -> str:
        """The change as text for reports."""
        parts = (
            ("air", self.air),
            ("reservoirs", self.reservoirs),
            ("differential pressure valve", self.dpv),
        )
        return ", ".join(f"{what} {to}" for what, to in parts if to is not None)


Segment = Wave | RestPose | Valves

#: Motion that removes the influence of earlier motions on friction, up to the amplitude of the following motions. It
#: reduces a difference in the state of Berg's model to 4e-4 (three cycles only to 1e-2, which is still measurable).
WIPE: Final = (
    Wave("vertical", 10 * mm, 1 * Hz, 5),
    Wave("lateral", 10 * mm, 1 * Hz, 5),
)
#: Nothing moves before and after a stretch, and between conditioning and motion: it shows noise and initial state.
REST_BEFORE: Final = 1 * s
REST_BETWEEN: Final = 2 * s
REST_AFTER: Final = 1 * s


@dataclass(frozen=True, slots=True)
class Stretch:
    """One run that can be replayed. The bench goes to ``start``, rests, does the ``condition`` waves, rests again, and
    performs the ``segments``.
    """

    segments: tuple[Segment, ...]
    start: RestPose = RestPose()
    condition: tuple[Wave, ...] = WIPE
    valves: Valves = Valves(air="hold", reservoirs="on", dpv="off")  #: from its beginning


@dataclass(frozen=True, slots=True)
class Part:
    """Motions (`Stretch`) under one load. Before the first one, the springs take up this load with the leveling valves
    on.
    """

    load: str  #: load case of the specimen
    stretches: tuple[Stretch, ...]


@dataclass(frozen=True, slots=True)
class Programme:
    """The motions of one session on the bench. Its plan and its record have its name. ``purpose`` is the end of the
    plan's instruction.
    """

    name: str
    title: str
    parts: tuple[Part, ...]
    purpose: str
