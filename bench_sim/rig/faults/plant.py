"""The faults of the plant, by name: of its air supply, valves and actuators."""

from typing import Any, Final

from bench_protocol.words import ACTUATORS, SIDES
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.effects.gas import sonic_conductance
from bench_sim.model.layout import Input, Mode
from bench_sim.rig.faults.fault import Fault, FaultChoice, FaultNumber, FaultPlace, Values
from bench_sim.rig.faults.insertion import InsertionPoints
from bench_sim.rig.faults.schedule import Undo

_SIDE: Final = FaultChoice("side", SIDES, "affected spring")
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
        "A bellows leaks. This fault is the effect of the same name, at any time.",
        "At constant height, the pressure of the spring falls. The leveling valve compensates for it and uses "
        "supply air.",
        _leak,
        (_SIDE, FaultNumber("area", "mm2", 0.01, 20, "effective area of the hole", 2)),
        "side",
    ),
    Fault(
        "burst",
        FaultPlace.PLANT,
        "A bellows tears. No valve can replace the lost air.",
        "The spring loses its pressure within seconds. The bolster rests on its emergency spring, unless actuators "
        "hold it.",
        _burst,
        (_SIDE, FaultNumber("area", "mm2", 20, 2000, "effective area of the hole", 500)),
        "side",
    ),
    Fault(
        "blocked_orifice",
        FaultPlace.PLANT,
        "Dirt blocks a part of the orifice between bellows and auxiliary chamber. This fault is the effect of the "
        "same name, at any time.",
        "The pressures of bellows and auxiliary chamber differ during motion and filling, and the spring is "
        "stiffer.",
        _blocked,
        (_SIDE, FaultNumber("share", "%", 1, 99, "of its area", 90)),
        "side",
    ),
    Fault(
        "stuck_leveling",
        FaultPlace.PLANT,
        "A leveling valve no longer follows its lever: it stays in its position, is closed, or always fills or "
        "exhausts.",
        "In the air mode `level` the height does not return to its dead band: it stays, rises or falls.",
        _leveling,
        (
            _SIDE,
            FaultChoice(
                "at", ("as_is", "shut", "filling", "exhausting"), "position of the stuck valve", "as_is"
            ),
        ),
        "side",
    ),
    Fault(
        "stuck_dpv",
        FaultPlace.PLANT,
        "The differential pressure valve is stuck.",
        "Open: both auxiliary chambers get the same pressure while the valve is connected. Shut: their difference "
        "is not limited.",
        _dpv,
        (FaultChoice("at", ("open", "shut"), "position of the stuck valve"),),
    ),
    Fault(
        "stuck_service_valve",
        FaultPlace.PLANT,
        "A service valve of the bench is stuck.",
        "The auxiliary chamber does not reach its target: its pressure stays, rises to that of the supply, or "
        "falls to the atmosphere. If the valve is shut or filling, the spring is not vented.",
        _service_valve,
        (_SIDE, FaultChoice("at", ("filling", "shut", "exhausting"), "position of the stuck valve")),
        "side",
    ),
    Fault(
        "stuck_reservoir_valve",
        FaultPlace.PLANT,
        "The valve between a bellows and its auxiliary chamber is stuck.",
        "Shut: the pressure of the bellows does not follow that of its auxiliary chamber, and venting does not "
        "empty it. Open: the chamber cannot be disconnected.",
        _reservoir_valve,
        (_SIDE, FaultChoice("at", ("open", "shut"), "position of the stuck valve", "shut")),
        "side",
    ),
    Fault(
        "seized_actuator",
        FaultPlace.PLANT,
        "An actuator does not move below the force of its relief valves.",
        "The displacement does not follow the set-points, and the force is that of the load.",
        _seized,
        (FaultChoice("actuator", ACTUATORS, "affected actuator"),),
        "actuator",
    ),
    Fault(
        "supply_loss",
        FaultPlace.PLANT,
        "The compressed air before the main valve fails, or its pressure is low.",
        "`supply.pressure` falls to this value within a second. No spring can be filled beyond it. Check valves "
        "keep the air in the springs.",
        _supply,
        (FaultNumber("pressure", "bar", 0, 12, "remaining gauge pressure", 0),),
    ),
)
