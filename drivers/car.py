"""The car that a rig simulates in its tick: parameters, start and end of a ride."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from bench_protocol.units import s
from drivers.declarations import Device, Reading, Setpoint, Setting
from drivers.errors import NotAvailable
from drivers.generator import wait_for_the_end
from drivers.link import STREAM_CYCLES

#: Signals that a rig needs for a car in the loop.
RIDES: Final = ("action.program_car", "car.wind_setpoint", "car.shear", "car.acceleration")


class Car(Device):
    """A car in the loop: ``bench.car``. The measured forces of the springs move it, and it moves the springs.

    A ride is a program like those of the generator: ``bench.generator`` holds and stops it.
    """

    __slots__ = ()
    mass = Setting()  #: kg, of half a car
    roll_gyration = Setting()  #: m
    centre_height = Setting()  #: m above the springs' top plates; the depths are below the centre of gravity
    floor_depth = Setting()
    wind_height = Setting()  #: m above the centre of gravity
    damper_rate = Setting()  #: N·s/m
    damper_depth = Setting()
    bump_stop_depth = Setting()
    anti_roll_stiffness = Setting()  #: N·m/rad
    stop_travel_1 = Setting()  #: m
    stop_travel_2 = Setting()
    stop_travel_3 = Setting()
    stop_travel_4 = Setting()
    stop_travel_5 = Setting()
    stop_travel_6 = Setting()
    stop_travel_7 = Setting()
    stop_travel_8 = Setting()
    stop_travel_9 = Setting()
    stop_force_1 = Setting()  #: N
    stop_force_2 = Setting()
    stop_force_3 = Setting()
    stop_force_4 = Setting()
    stop_force_5 = Setting()
    stop_force_6 = Setting()
    stop_force_7 = Setting()
    stop_force_8 = Setting()
    stop_force_9 = Setting()
    track_frequency = Setting()  #: Hz
    track_waves = Setting()
    track_lateral = Setting()  #: m
    track_vertical = Setting()  #: m
    track_roll = Setting()  #: rad
    piston_lead = Setting()  #: s
    platform_lead = Setting()  #: s
    shear = Reading()  #: m, of the springs under the car
    height = Reading()  #: m
    roll = Reading()  #: rad, against the track
    acceleration = Reading()  #: m/s², of the floor, lateral
    rising = Reading()  #: m/s²
    bump_stop = Reading()  #: N
    wind = Reading()  #: N
    wind_setpoint = Setpoint()  #: N

    def start(self, car: Mapping[str, float]) -> None:
        """Write the settings of a ``car`` (SI, by name), set the wind to 0, and start the ride.

        All actuators must be in displacement control. The rig first measures the load of the springs at rest for one
        second. Raises Refused for an invalid car or a track that the actuators cannot follow, NotAvailable on a rig
        without a car.
        """
        link = self._link
        if lacking := link.lacks(*RIDES):
            raise NotAvailable(lacking)
        link.commander.set("car.wind_setpoint", 0.0)
        link.settings.write({f"car.{name}": value for name, value in car.items()})
        link.settings.act("action.program_car")
        link.wait_cycles(STREAM_CYCLES, "rig.program")

    def wait_done(self, within: float = 10 * s) -> None:
        """Wait until the ride has ended with its last wave, at most ``within`` s.

        Raises RigFault if it ended earlier, and BenchTimeout if it has not ended by then.
        """
        wait_for_the_end(self._link, self.track_waves, within)
