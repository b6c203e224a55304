"""Devices with readings and settings only. Axes, air and generator have their own modules with methods."""

from __future__ import annotations

from drivers.declarations import (
    Action,
    Bit,
    ChoiceReading,
    ChoiceSetting,
    Contact,
    Device,
    Reading,
    Setpoint,
    Setting,
)
from drivers.errors import Misuse


class Spring(Device):
    """One air spring with its auxiliary chamber: ``bench.left``, ``bench.right``."""

    __slots__ = ()
    height = Reading()  #: m over design height, up positive
    bellows_pressure = Reading()  #: Pa gauge
    auxiliary_pressure = Reading()  #: Pa gauge
    bellows_temperature = Reading()  #: K
    auxiliary_temperature = Reading()  #: K


class LoadCells(Device):
    """The load cells: ``bench.load_cell[1]`` to ``[8]`` (N).

    On our bench 1 to 4 are upright, 5 and 6 lateral, and 7 and 8 are missing.
    """

    __slots__ = ()
    cell_1 = Reading("1")
    cell_2 = Reading("2")
    cell_3 = Reading("3")
    cell_4 = Reading("4")
    cell_5 = Reading("5")
    cell_6 = Reading("6")
    cell_7 = Reading("7")
    cell_8 = Reading("8")

    def __getitem__(self, cell: int) -> float:
        if cell not in range(1, 9):
            raise Misuse(f"load_cell[{cell}] does not exist; the cells are 1 to 8")
        return self._link.readings.value(f"{self._name}.{cell}")


class Supply(Device):
    """The air supply: ``bench.supply``."""

    __slots__ = ()
    pressure = Reading()  #: Pa gauge


class RigStatus(Device):
    """The state and the configuration of the rig: ``bench.rig``."""

    __slots__ = ()
    nominal_preload = Setting()  #: N per spring at zero height; set it without load
    orifice_diameter = Setting()  #: m, plates of both sides; change them disengaged and without pressure
    pipe = ChoiceSetting()  #: "off" | "on": connecting pipes; change them like the plates
    state = ChoiceReading()
    program = ChoiceReading()
    reason = ChoiceReading()
    tripped = Reading()
    tripped_kind = ChoiceReading()
    tripped_value = Reading()  #: raw value (steps) of the reading that tripped
    tripped_tick = Reading()
    status_code = Reading()
    lease = Reading()  #: the token of the commander that holds the lease, 0 if it is free
    holder = Reading()  #: TCP port of the commander with the lease, 0 if there is none or its port is unknown
    strangers = Reading()  #: frames and requests of other clients, which were rejected
    stranger = Reading()  #: TCP port of the last such client, 0 if unknown
    stranger_identifier = Reading()  #: CAN identifier of the last such frame, 0 for Modbus
    generator_cycle = Reading()
    tick = Reading()
    late_ticks = Reading()
    lateness_max = Reading()  #: s
    rejected_commands = Reading()
    refused_setpoints = Reading()
    map_hash = Reading()
    lateness_50us = Reading()
    lateness_100us = Reading()
    lateness_250us = Reading()
    lateness_500us = Reading()
    lateness_1ms = Reading()
    lateness_more = Reading()


class Emergency(Device):
    """The last CANopen emergency of the rig: ``bench.emergency``; NaN before the first."""

    __slots__ = ()
    code = Reading()
    register = Reading()
    reason = Reading()


class Control(Device):
    """The bits of the Control message: ``bench.control``; ``bench.arm()`` and ``disarm()`` set them in order."""

    __slots__ = ()
    enable = Bit()  #: D
    hold = Bit()  #: H
    active = Bit()  #: M
    reset = Bit()  #: R
    token = Setpoint()  #: assigned by the rig to this commander; set by the bench


class LeaseRequest(Device):
    """A request for the lease on CAN: ``bench.lease``; the bench itself takes the lease on Modbus."""

    __slots__ = ()
    nonce = Setpoint()
    token = Setpoint()


class Actions(Device):
    """The actions of the rig: ``bench.action.program_stop()``."""

    __slots__ = ()
    apply = Action()
    reset = Action()
    power_on = Action()
    power_off = Action()
    air_low = Action()
    air_high = Action()
    disable = Action()
    program_run = Action()
    program_hold = Action()
    program_stop = Action()
    program_add = Action()
    program_car = Action()


class Interlocks(Device):
    """The contacts, polled on request: ``bench.interlock.estop``."""

    __slots__ = ()
    estop = Contact()
    pneumatic = Contact()
    program = Contact()
    command = Contact()
    limits = Contact()
    fault = Contact()
    staged = Contact()
