"""The axes of the bench: vertical and lateral actuators and the platform, and their motions."""

from __future__ import annotations

from typing import Final, Literal

from bench_protocol.units import kN, minutes, mm, mrad, s
from drivers.declarations import ChoiceSetting, Device, Reading, Setpoint
from drivers.link import STREAM_CYCLES, Link

Mode = Literal["off", "force", "displacement"]

#: Tolerances for comparing one noisy sample with its target.
FORCE_TOLERANCE: Final = 0.5 * kN
DISPLACEMENT_TOLERANCE: Final = 1 * mm
ANGLE_TOLERANCE: Final = 1 * mrad
#: Time that a move may take in addition to its ramp.
MARGIN: Final = 10 * s


class VerticalActuator(Device):
    """One vertical actuator: ``bench.vertical_left``, ``bench.vertical_right``; force positive downward."""

    __slots__ = ()
    force = Reading()  #: N
    displacement = Reading()  #: m
    force_setpoint = Setpoint()  #: N
    displacement_setpoint = Setpoint()  #: m


class ControlMode(ChoiceSetting):
    """The control mode of an axis. Before a change, the set-points of the new mode are set to the measured values, so
    that the axis does not jump.
    """

    def set(self, link: Link, name: str, value: str) -> None:
        axis = name.partition(".")[0]
        actuators = ("vertical_left", "vertical_right") if axis == "vertical" else (axis,)
        link.settings.number(name, value)
        if value != "off":
            link.take_over([f"{actuator}.{value}" for actuator in actuators])
        link.settings.write({name: value})
        link.wait_cycles(STREAM_CYCLES)


class Vertical(Device):
    """Both vertical actuators together: ``bench.vertical``."""

    __slots__ = ()
    control = ControlMode()  #: "off" | "force" | "displacement"

    def preload(
        self,
        left: float,
        right: float,
        *,
        rate: float = 10 * kN / s,
        within: float = 2 * minutes,
        tolerance: float = FORCE_TOLERANCE,
    ) -> None:
        """Press with the forces ``left`` and ``right`` (N, downward) in force control, and wait until these forces are
        measured.

        The set-points move along ramps of ``rate`` (N/s). Raises BenchTimeout if the forces are not within
        ``tolerance`` (N) after ``within`` s.
        """
        _mode(self, "force")
        targets = {"vertical_left.force": left, "vertical_right.force": right}
        _move(self._link, targets, rate, within, dict.fromkeys(targets, tolerance))

    def move_to(
        self,
        left: float,
        right: float,
        *,
        rate: float = 10 * mm / s,
        within: float | None = None,
        tolerance: float = DISPLACEMENT_TOLERANCE,
    ) -> None:
        """Move both actuators to ``left`` and ``right`` (m) with ``rate`` (m/s), in displacement control, and wait
        until they are there.

        Raises BenchTimeout if the displacements are not within ``tolerance`` (m) after ``within`` s (default: the
        duration of the ramps and `MARGIN`).
        """
        _mode(self, "displacement")
        targets = {"vertical_left.displacement": left, "vertical_right.displacement": right}
        _move(self._link, targets, rate, within, dict.fromkeys(targets, tolerance))

    def hold_position(self) -> None:
        """Hold the actuators at their present displacements, in displacement control."""
        self.control = "displacement"


class Lateral(Device):
    """The lateral actuator and the readings in its direction: ``bench.lateral``; positive to the left."""

    __slots__ = ()
    force = Reading()  #: N
    displacement = Reading()  #: m
    acceleration = Reading()  #: m/s² across the bolster, including the component of gravity when it tilts
    force_setpoint = Setpoint()  #: N
    displacement_setpoint = Setpoint()  #: m
    control = ControlMode()  #: "off" | "force" | "displacement"

    def move_to(
        self,
        displacement: float,
        rate: float = 10 * mm / s,
        *,
        within: float | None = None,
        tolerance: float = DISPLACEMENT_TOLERANCE,
    ) -> None:
        """Move to ``displacement`` (m) with ``rate`` (m/s), in displacement control, and wait until it is measured.

        ``tolerance`` (m) and ``within`` (s) are as in `Vertical.move_to`.
        """
        _mode(self, "displacement")
        name = "lateral.displacement"
        _move(self._link, {name: displacement}, rate, within, {name: tolerance})

    def push(
        self,
        force: float,
        rate: float = 2 * kN / s,
        *,
        within: float | None = None,
        tolerance: float = FORCE_TOLERANCE,
    ) -> None:
        """Push with ``force`` (N), along a ramp of ``rate`` (N/s), in force control, and wait until it is measured.

        ``tolerance`` (N) and ``within`` (s) are as in `Vertical.move_to`.
        """
        _mode(self, "force")
        _move(self._link, {"lateral.force": force}, rate, within, {"lateral.force": tolerance})

    def hold_position(self) -> None:
        """Hold the actuator at its present displacement, in displacement control."""
        self.control = "displacement"


class Platform(Device):
    """The vibration platform: ``bench.platform``. Positive is up, to the left, and left side up."""

    __slots__ = ()
    vertical = Reading()  #: m
    lateral = Reading()  #: m
    roll = Reading()  #: rad
    vertical_setpoint = Setpoint()  #: m
    lateral_setpoint = Setpoint()  #: m
    roll_setpoint = Setpoint()  #: rad

    def move_to(
        self,
        vertical: float | None = None,
        lateral: float | None = None,
        roll: float | None = None,
        *,
        rate: float = 10 * mm / s,
        roll_rate: float = 10 * mrad / s,
        within: float | None = None,
    ) -> None:
        """Move the given axes to their positions (m, m, rad), and wait until they are there.

        Displacements move with ``rate`` (m/s), the roll with ``roll_rate`` (rad/s). An axis without a position does not
        move. ``within`` (s) is as in `Vertical.move_to`.
        """
        straight = {"platform.vertical": vertical, "platform.lateral": lateral}
        lengths = {name: to for name, to in straight.items() if to is not None}
        angles = {"platform.roll": roll} if roll is not None else {}
        tolerance = {
            name: ANGLE_TOLERANCE if name in angles else DISPLACEMENT_TOLERANCE for name in lengths | angles
        }
        longest = max(_start(self._link, lengths, rate), _start(self._link, angles, roll_rate))
        _arrive(self._link, lengths | angles, longest + MARGIN if within is None else within, tolerance)


def _mode(device: Vertical | Lateral, mode: Mode) -> None:
    if device.control != mode:
        device.control = mode


def _start(link: Link, targets: dict[str, float], rate: float) -> float:
    """Start ramps of the set-points that belong to the readings in ``targets``; return the longest duration (s)."""
    return link.commander.ramp_all({f"{name}_setpoint": to for name, to in targets.items()}, rate)


def _move(
    link: Link, targets: dict[str, float], rate: float, within: float | None, tolerance: dict[str, float]
) -> None:
    duration = _start(link, targets, rate)
    _arrive(link, targets, duration + MARGIN if within is None else within, tolerance)


def _arrive(link: Link, targets: dict[str, float], within: float, tolerance: dict[str, float]) -> None:
    """Wait until all ramps have ended and the measured values are within ``tolerance`` (SI, by reading) of their
    ``targets``, at most ``within`` s.
    """
    read, moving = link.readings.value, link.commander.moving
    setpoints = [f"{name}_setpoint" for name in targets]
    link.wait_for(
        lambda: (
            not moving(*setpoints) and all(abs(read(n) - to) <= tolerance[n] for n, to in targets.items())
        ),
        within=within,
        what=" and ".join(f"{name} at {link.table[name].show(to)}" for name, to in targets.items()),
    )
