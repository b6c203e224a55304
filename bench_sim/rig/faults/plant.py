"""The faults of the plant, by name: air, valves and actuators of the bench itself."""

from typing import Any, Final

from bench_protocol.words import ACTUATORS, SIDES
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.effects.gas import sonic_conductance
from bench_sim.model.layout import Input, Mode
from bench_sim.rig.faults.fault import Fault, FaultChoice, FaultNumber, FaultPlace, Values
from bench_sim.rig.faults.insertion import InsertionPoints
from bench_sim.rig.faults.schedule import Undo

_SIDE: Final = FaultChoice("side", SIDES, "which spring")
#: The end of a detached lever is far outside the range of its valve, but near enough to return within seconds.
_LEVER_GONE: Final = 0.1
#: Beyond every lever and every pressure.
_NEVER: Final = 1e12


def _leak(points: InsertionPoints, v: Values) -> Undo:
    side = SIDES.index(v["side"])
    return points.parameters.change(
        ("leak_conductance",),
        lambda par: CATALOGUE["leak"].change(par, side, {"area": v["area"]}),
    )


def _burst(points: InsertionPoints, v: Values) -> Undo:
    side, hole = SIDES.index(v["side"]), sonic_conductance(v["area"], points.gas_constant)

    def change(par: Any) -> None:
        par.leak_conductance[side] += hole

    return points.parameters.change(("leak_conductance",), change)


def _blocked(points: InsertionPoints, v: Values) -> Undo:
    side = SIDES.index(v["side"])
    return points.parameters.change(
        ("discharge_coefficient",),
        lambda par: CATALOGUE["blocked_orifice"].change(
            par, side, {CATALOGUE["blocked_orifice"].amplitude.name: v["share"]}
        ),
    )


def _leveling(points: InsertionPoints, v: Values) -> Undo:
    side, how = SIDES.index(v["side"]), v["at"]

    def change(par: Any) -> None:
        if how == "shut":
            par.leveling_deadband[side] = _NEVER
        elif how == "exhausting":
            par.leveling_deadband[side] = -_NEVER
            par.leveling_hysteresis[side] = 0.0
        elif how == "filling":
            par.lever_offset[side] -= _LEVER_GONE
        else:
            par.leveling_lag[side] = _NEVER

    names = ("leveling_deadband", "leveling_hysteresis", "lever_offset", "leveling_lag")
    return points.parameters.change(names, change)


def _dpv(points: InsertionPoints, v: Values) -> Undo:
    shut = v["at"] == "shut"

    def change(par: Any) -> None:
        par.dpv_opening = _NEVER if shut else -1.0
        par.dpv_reclosing = _NEVER if shut else -1.0

    return points.parameters.change(("dpv_opening", "dpv_reclosing"), change)


def _service_valve(points: InsertionPoints, v: Values) -> Undo:
    opening = {"filling": 1.0, "shut": 0.0, "exhausting": -1.0}[v["at"]]
    return points.tick.hold({Input(Input.LEFT_SERVICE_VALVE + SIDES.index(v["side"])): opening})


def _reservoir_valve(points: InsertionPoints, v: Values) -> Undo:
    place = Input(Input.LEFT_RESERVOIR_VALVE + SIDES.index(v["side"]))
    return points.tick.hold({place: 1.0 if v["at"] == "open" else 0.0})


def _seized(points: InsertionPoints, v: Values) -> Undo:
    place = ACTUATORS.index(v["actuator"])
    return points.tick.hold(
        {
            Input(Input.VERTICAL_LEFT_MODE + place): float(Mode.SHUT_IN),
            Input(Input.VERTICAL_LEFT_COMMAND + place): 0.0,
        }
    )


def _supply(points: InsertionPoints, v: Values) -> Undo:
    def change(par: Any) -> None:
        par.supply_sawtooth = 0.0
        par.supply_pressure = v["pressure"]

    return points.parameters.change(("supply_sawtooth", "supply_pressure"), change)


FAULTS: Final = (
    Fault(
        "leak",
        FaultPlace.PLANT,
        "A hole in a bellows: the effect of this name, while the rig runs.",
        "The pressure of the spring falls, at held height; the leveling valve makes up for it and the supply works.",
        _leak,
        (_SIDE, FaultNumber("area", "mm2", 0.01, 20, "effective area of the hole", 2)),
        "side",
    ),
    Fault(
        "burst",
        FaultPlace.PLANT,
        "A bellows tears: a hole that no valve can feed.",
        "The pressure of the spring is gone within seconds, and the bolster sits on its emergency spring unless "
        "actuators hold it.",
        _burst,
        (_SIDE, FaultNumber("area", "mm2", 20, 2000, "effective area of the hole", 500)),
        "side",
    ),
    Fault(
        "blocked_orifice",
        FaultPlace.PLANT,
        "Dirt blocks a part of the orifice between bellows and auxiliary chamber: the effect of this name, while "
        "the rig runs.",
        "The pressures of bellows and auxiliary chamber part when the spring moves or is filled, and the spring is "
        "stiffer.",
        _blocked,
        (_SIDE, FaultNumber("share", "%", 1, 99, "of its area", 90)),
        "side",
    ),
    Fault(
        "stuck_leveling",
        FaultPlace.PLANT,
        "A leveling valve no longer follows its lever: it stays as it is, is shut, or fills or exhausts all the time.",
        "In the air mode `level` the height does not come back to its dead band: it stays off, or runs up or down.",
        _leveling,
        (_SIDE, FaultChoice("at", ("as_is", "shut", "filling", "exhausting"), "where it is stuck", "as_is")),
        "side",
    ),
    Fault(
        "stuck_dpv",
        FaultPlace.PLANT,
        "The differential pressure valve is stuck.",
        "Open: both auxiliary chambers come to one pressure while the valve is connected. Shut: they can differ by any "
        "pressure.",
        _dpv,
        (FaultChoice("at", ("open", "shut"), "where it is stuck"),),
    ),
    Fault(
        "stuck_service_valve",
        FaultPlace.PLANT,
        "A service valve of the bench is stuck.",
        "The auxiliary chamber does not come to its target: its pressure stays, runs up to the supply or down to the "
        "atmosphere. Shut or filling, the spring is not vented.",
        _service_valve,
        (_SIDE, FaultChoice("at", ("filling", "shut", "exhausting"), "where it is stuck")),
        "side",
    ),
    Fault(
        "stuck_reservoir_valve",
        FaultPlace.PLANT,
        "The valve between a bellows and its auxiliary chamber is stuck.",
        "Shut: the pressure of the bellows does not follow that of its auxiliary chamber, and venting does not empty "
        "it. Open: shutting it off does nothing.",
        _reservoir_valve,
        (_SIDE, FaultChoice("at", ("open", "shut"), "where it is stuck", "shut")),
        "side",
    ),
    Fault(
        "seized_actuator",
        FaultPlace.PLANT,
        "An actuator does not move below the force of its relief valves.",
        "The displacement stays where it is, set-points or not; the force is what it takes.",
        _seized,
        (FaultChoice("actuator", ACTUATORS, "which one"),),
        "actuator",
    ),
    Fault(
        "supply_loss",
        FaultPlace.PLANT,
        "The compressed air before the main valve fails, or is low.",
        "`supply.pressure` falls to that within a second; nothing can be filled beyond it, check valves keep what is "
        "in the springs.",
        _supply,
        (FaultNumber("pressure", "bar", 0, 12, "what is left, gauge", 0),),
    ),
)
