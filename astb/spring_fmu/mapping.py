"""What of an FMU is what of a spring: names, units and signs of a map, checked and turned into numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Final

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from astb.spring_fmu.keys import PATIENCE_MAX, SpringFmuError, SpringMap, VariableKeys
from bench_protocol.base_units import base_exponents
from bench_protocol.rates import TICK
from bench_protocol.units import ATMOSPHERE, UNITS, WRITTEN_UNITS
from bench_protocol.words import SIDES
from bench_protocol.written_values import NotAValue, read_written
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.elsewhere import SUPPLY_TAKEN, Feed, Hold
from diagnosis.systems.fmu.description import REALS, Fmu, Variable

#: What is fed of one spring, its unit, and its place on the left; a step further on the right.
_FED: Final = {
    "height": ("m", Feed.HEIGHT, 1),
    "height_speed": ("m/s", Feed.HEIGHT_SPEED, 1),
    "height_acceleration": ("m/s2", Feed.HEIGHT_ACCELERATION, 1),
    "lateral": ("m", Feed.LATERAL, 0),
    "lateral_speed": ("m/s", Feed.LATERAL_SPEED, 0),
    "lateral_acceleration": ("m/s2", Feed.LATERAL_ACCELERATION, 0),
    "roll": ("rad", Feed.ROLL, 0),
    "roll_speed": ("rad/s", Feed.ROLL_SPEED, 0),
    "roll_acceleration": ("rad/s2", Feed.ROLL_ACCELERATION, 0),
    "leveling": ("1", Feed.LEVELING, 1),
    "service_valve": ("1", Feed.SERVICE_VALVE, 1),
    "reservoir": ("1", Feed.RESERVOIR, 1),
    "supply_open": ("1", Feed.SUPPLY, 0),
    "dpv": ("1", Feed.DPV, 0),
    "supply_pressure": ("Pa", Feed.SUPPLY_PRESSURE, 0),
    "air_flow": ("kg/s", Feed.AIR_FLOW, 1),
    "air_power": ("W", Feed.AIR_POWER, 1),
    "nominal_preload": ("N", Feed.NOMINAL_PRELOAD, 1),
    "orifice_diameter": ("m", Feed.ORIFICE_DIAMETER, 1),
}
#: What both springs have in common, as one instance for both calls it.
_COMMON: Final = {
    "lateral": "springs.lateral",
    "lateral_speed": "springs.lateral_speed",
    "lateral_acceleration": "springs.lateral_acceleration",
    "roll": "springs.roll",
    "roll_speed": "springs.roll_speed",
    "roll_acceleration": "springs.roll_acceleration",
    "supply_open": "supply.open",
    "dpv": "air.dpv",
    "supply_pressure": "supply.pressure",
}
_TAKEN: Final = {
    "vertical_force": ("N", Algebraic.VERTICAL_FORCE),
    "lateral_force": ("N", Algebraic.LATERAL_FORCE),
    "roll_moment": ("N*m", Algebraic.ROLL_MOMENT),
    "bellows_pressure": ("Pa", Algebraic.PRESSURE),
    "auxiliary_pressure": ("Pa", Algebraic.AUXILIARY_PRESSURE),
    "bellows_temperature": ("K", Algebraic.TEMPERATURE),
    "auxiliary_temperature": ("K", Algebraic.AUXILIARY_TEMPERATURE),
}
#: By which air gets into a spring.
_AIR: Final = ("air_flow", "leveling", "service_valve")
_NEEDED: Final = ("vertical_force", "bellows_pressure")
#: What an FMU without a map may begin with, so that it begins as the rig does: without air.
_WITHOUT_AIR: Final = "air.at_start"


@dataclass(frozen=True, slots=True)
class Link:
    """A variable of one instance: its number is ``scale`` · value + ``zero``, or for outputs the other way round."""

    name: str
    reference: int
    place: int
    scale: float
    zero: float


@dataclass(frozen=True, slots=True)
class Instance:
    """One instance of the FMU: what is fed and taken, and (reference, number) of what is set before it begins."""

    name: str
    inputs: tuple[Link, ...]
    outputs: tuple[Link, ...]
    parameters: tuple[tuple[int, float], ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """How an FMU stands in for both springs. ``said``: what should be known of it before."""

    fmu: Fmu
    instances: tuple[Instance, ...]
    ticks: int  #: of one communication step
    hold: Hold
    valves: bool  #: those of the bench feed the springs
    patience: float  #: s
    apart: bool
    said: tuple[str, ...]

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Number of instances, inputs, and outputs."""
        inputs = sum(len(one.inputs) for one in self.instances)
        return len(self.instances), inputs, sum(len(one.outputs) for one in self.instances)


def plan_of(fmu: Fmu, keys: SpringMap, ambient: float) -> Plan:
    """Return how ``fmu`` stands in for the springs. ``ambient`` is the temperature in K of gas that it does not tell.

    Raises `SpringFmuError`, which names the key, what the FMU says, and what would be right.
    """
    own = not keys.inputs and not keys.outputs
    if own:
        keys = _own_names(fmu, keys)
    both = _both_sides(keys)
    sides = (("", None),) if both else tuple((side, place) for place, side in enumerate(SIDES))
    said: list[str] = []
    instances = tuple(_instance(fmu, keys, side, place, ambient, said) for side, place in sides)
    _refuse_half(fmu, keys, instances)
    known = {name.rpartition(".")[2] for name in keys.inputs}
    if not known & set(_AIR):
        raise SpringFmuError(
            f"{fmu.path.name} gets no air: spring_map.inputs has none of {', '.join(_AIR)}; right would be the air "
            "that the bench's valves let in, or how far its valves are open"
        )
    ticks = _ticks(fmu, keys)
    patience = _seconds("spring_map.patience", keys.patience, PATIENCE_MAX)
    hold = Hold.BEGIN if own else Hold[keys.hold.upper()]
    valves = "air_flow" in known
    return Plan(fmu, instances, ticks, hold, valves, patience, keys.process == "own", tuple(said))


def _own_names(fmu: Fmu, keys: SpringMap) -> SpringMap:
    """Return the map of an FMU that calls everything as the bench does."""
    there = fmu.variables
    inputs = {name: name for name in _fed_names() if name in there and _may_be_fed(there[name])}
    outputs = {name: name for name in _taken_names() if name in there and there[name].causality == "output"}
    lacks = [f"{side}.{name}" for name in ("height", *_NEEDED) for side in SIDES]
    missing = [name for name in lacks if name not in inputs and name not in outputs]
    if missing:
        raise SpringFmuError(
            f"{fmu.path.name} has no {', '.join(missing)}: its names are its own, so that spring_map has to "
            f'say which is which, such as outputs.vertical_force = "{_some_output(fmu)}"'
        )
    parameters = dict(keys.parameters)
    if _WITHOUT_AIR in there:
        parameters.setdefault(_WITHOUT_AIR, 0.0)
    pressures = (*(name for name in outputs if name.endswith("_pressure")), "supply.pressure")
    return replace(
        keys, inputs=inputs, outputs=outputs, parameters=parameters, gauge=(*keys.gauge, *pressures)
    )


def _may_be_fed(one: Variable) -> bool:
    return one.causality == "input" or (one.causality == "parameter" and one.variability == "tunable")


def _some_output(fmu: Fmu) -> str:
    return next((one.name for one in fmu.variables.values() if one.causality == "output"), "F")


def _fed_names() -> dict[str, tuple[str, int]]:
    """Return unit and place by every name that an input for both sides may have."""
    names: dict[str, tuple[str, int]] = {}
    for name, (unit, place, per_side) in _FED.items():
        if not per_side:
            names[_COMMON[name]] = unit, int(place)
            continue
        for side, word in enumerate(SIDES):
            full = f"air.{word}_reservoir" if name == "reservoir" else f"{word}.{name}"
            names[full] = unit, int(place) + side
    return names


def _taken_names() -> dict[str, tuple[str, int]]:
    names = {
        f"{word}.{name}": (unit, int(place) + side)
        for name, (unit, place) in _TAKEN.items()
        for side, word in enumerate(SIDES)
    }
    return names | {"supply.pressure": ("Pa", SUPPLY_TAKEN)}


def _both_sides(keys: SpringMap) -> bool:
    """Whether one instance is both springs; SpringFmuError where names of both kinds are mixed."""
    kinds = {("." in name) for name in (*keys.inputs, *keys.outputs)}
    if len(kinds) == 2:
        raise SpringFmuError(
            "spring_map has names of one spring, such as height, beside those of both, such as left.height; right is "
            "one kind: an instance a side, or one for both"
        )
    return kinds == {True}


def _instance(
    fmu: Fmu, keys: SpringMap, side: str, place: int | None, ambient: float, said: list[str]
) -> Instance:
    """Return one instance: of a ``side``, or with "" of both."""
    if place is None:
        fed, taken = _fed_names(), _taken_names()
    else:
        fed = {name: (unit, int(where) + one * place) for name, (unit, where, one) in _FED.items()}
        taken = {name: (unit, int(where) + place) for name, (unit, where) in _TAKEN.items()}
    inputs = tuple(_link(fmu, keys, "inputs", name, entry, fed) for name, entry in keys.inputs.items())
    outputs = [_link(fmu, keys, "outputs", name, entry, taken) for name, entry in keys.outputs.items()]
    outputs += _rest(fmu, outputs, taken, ambient, said)
    parameters = tuple(_parameters(fmu, keys.parameters, side))
    return Instance(side or "springs", inputs, tuple(outputs), parameters)


def _link(
    fmu: Fmu,
    keys: SpringMap,
    kind: str,
    name: str,
    entry: str | VariableKeys,
    known: Mapping[str, tuple[str, int]],
) -> Link:
    """Return what one line of the map says."""
    where = f"spring_map.{kind}.{name}"
    if name not in known:
        near = get_close_matches(name, known, n=1)
        right = f"{near[0]} would be one" if near else f"there are {', '.join(known)}"
        raise SpringFmuError(f"{where}: the bench has no such quantity; {right}")
    si, place = known[name]
    given = VariableKeys(entry) if isinstance(entry, str) else entry
    variable = fmu.variable(given.variable, where)
    _refuse_kind(variable, kind, where)
    factor, zero = _scale(variable, given.unit, si, where)
    if si == "Pa" and variable.name not in keys.gauge:
        zero -= ATMOSPHERE  # ours are over the atmosphere
    if kind == "inputs":
        return Link(variable.name, variable.reference, place, given.factor / factor, -zero / factor)
    return Link(variable.name, variable.reference, place, factor / given.factor, zero)


def _refuse_kind(variable: Variable, kind: str, where: str) -> None:
    if variable.type not in REALS - {"Float32"}:
        raise SpringFmuError(
            f"{where}: {variable.name} is {variable.type}; right is Real (FMI 2) or Float64 (FMI 3)"
        )
    right = {"inputs": ("input", "parameter that is tunable"), "outputs": ("output", "local")}[kind]
    fits = _may_be_fed(variable) if kind == "inputs" else variable.causality in right
    if not fits:
        raise SpringFmuError(
            f"{where}: {variable.name} is {variable.causality or 'local'} in the FMU; right is {' or '.join(right)}"
        )


def _scale(variable: Variable, unit: str, si: str, where: str) -> tuple[float, float]:
    """Return factor and zero: SI = factor · number + zero."""
    if unit and unit not in UNITS:
        raise SpringFmuError(f'{where}: unit = "{unit}" is not known; right would be such as {_units(si)}')
    if unit and base_exponents(UNITS[unit].si) != base_exponents(si):
        raise SpringFmuError(f'{where} is in {si}, which "{unit}" is not; right would be {_units(si)}')
    own = variable.unit
    if not own.name:
        return (UNITS[unit].factor, UNITS[unit].zero) if unit else (1.0, 0.0)
    plain = {base: power for base, power in own.exponents.items() if base != "rad"}
    if plain != {base: power for base, power in base_exponents(si).items() if base != "rad"}:
        raise SpringFmuError(
            f'{where} is in {si}, and {variable.name} in the FMU is in "{own.name}"; right would be '
            f"a variable in {_units(si)}"
        )
    if unit and (UNITS[unit].factor, UNITS[unit].zero) != (own.factor, own.zero):
        raise SpringFmuError(
            f'{where}: unit = "{unit}" contradicts the FMU, where {variable.name} is in "{own.name}"; right would be '
            "no unit here, or the FMU's"
        )
    return own.factor, own.zero


def _units(si: str) -> str:
    return " or ".join(name for name, one in WRITTEN_UNITS.items() if one.si == si)


def _rest(
    fmu: Fmu, outputs: list[Link], taken: Mapping[str, tuple[str, int]], ambient: float, said: list[str]
) -> list[Link]:
    """Return what the FMU does not tell: an auxiliary chamber is the bellows, gas as warm as its surroundings."""
    there = {one.place: one for one in outputs}
    rest = []
    for name, (si, place) in taken.items():
        base = name.rpartition(".")[2]
        if place in there or place == SUPPLY_TAKEN or base in _NEEDED:
            continue
        any_other = outputs[0].reference if outputs else 0
        if base == "auxiliary_pressure":
            same = there.get(place - Algebraic.AUXILIARY_PRESSURE + Algebraic.PRESSURE)
            if same is not None:
                rest.append(Link(name, same.reference, place, same.scale, same.zero))
            text = "that of the bellows"
        else:
            value = ambient if si == "K" else 0.0
            rest.append(Link(name, any_other, place, 0.0, value))
            text = f"{value:g} {si}"
        line = f"{fmu.path.name} does not tell {base}: {text} is taken"
        if line not in said:
            said.append(line)
    return rest


def _refuse_half(fmu: Fmu, keys: SpringMap, instances: tuple[Instance, ...]) -> None:
    """SpringFmuError for a spring that nobody stretches or that does nothing."""
    fed = {link.place for one in instances for link in one.inputs}
    taken = {link.place for one in instances for link in one.outputs}
    lacking = [
        *(f"inputs.{side}.height" for k, side in enumerate(SIDES) if Feed.HEIGHT + k not in fed),
        *(
            f"outputs.{side}.{name}"
            for name in _NEEDED
            for k, side in enumerate(SIDES)
            if _TAKEN[name][1] + k not in taken
        ),
    ]
    if lacking:
        names = [one.replace(".left.", ".").replace(".right.", ".") for one in lacking]
        right = lacking if _both_sides(keys) else list(dict.fromkeys(names))
        raise SpringFmuError(
            f"spring_map for {fmu.path.name} lacks {', '.join(right)}: without it there is no spring"
        )


def _parameters(fmu: Fmu, given: Mapping[str, str | int | float], side: str) -> list[tuple[int, float]]:
    """Return (reference, number) of each parameter of this instance; ``left.x`` is x of the left one."""
    found = []
    for key, value in given.items():
        name = key
        first, _, rest = key.partition(".")
        if key not in fmu.variables and side and first in SIDES:
            if first != side:
                continue
            name = rest
        where = f"spring_map.parameters.{key}"
        variable = fmu.variable(name, where)
        if not variable.settable or variable.type not in REALS:
            raise SpringFmuError(
                f"{where}: {name} is {variable.type}, {variable.causality}; right would be a real parameter"
            )
        number = _number(variable, value, where)
        if not variable.low <= number <= variable.high:
            raise SpringFmuError(
                f"{where} = {value!r} is outside {variable.low:g} to {variable.high:g} {variable.unit.name}, which the "
                "FMU says are its bounds"
            )
        found.append((variable.reference, number))
    return found


def _number(variable: Variable, value: str | int | float, where: str) -> float:
    if not isinstance(value, str):
        return float(value)
    try:
        return variable.unit.from_si(read_written(where, value, variable.unit.si or "1"))
    except NotAValue as error:
        raise SpringFmuError(str(error)) from None


def _ticks(fmu: Fmu, keys: SpringMap) -> int:
    """Return how many ticks a communication step has."""
    step = _seconds("spring_map.step", keys.step, 1.0) if keys.step else TICK
    ticks = round(step / TICK)
    if ticks < 1 or abs(ticks * TICK - step) > 1e-9:
        raise SpringFmuError(
            f'spring_map.step = "{keys.step}" is no whole number of ticks; right would be {TICK * 1e3:g} ms, or two '
            "of it, …"
        )
    if fmu.step is not None and not fmu.variable_steps:
        parts = ticks * TICK / fmu.step
        if round(parts) < 1 or abs(parts - round(parts)) > 1e-6:
            raise SpringFmuError(
                f"{fmu.path.name} takes steps of {fmu.step * 1e3:g} ms only, and spring_map.step is "
                f'{ticks * TICK * 1e3:g} ms; right would be step = "{fmu.step * 1e3:g} ms", or two of it, …'
            )
    return ticks


def _seconds(what: str, text: str, most: float) -> float:
    try:
        value = read_written(what, text, "s")
    except NotAValue as error:
        raise SpringFmuError(str(error)) from None
    if not 0.0 < value <= most:
        raise SpringFmuError(f'{what} = "{text}" is outside 0 to {most:g} s')
    return value


def fill(numbers: Mapping[str, npt.NDArray[np.float64]], plan: Plan) -> None:
    """Write references, places and scales of ``plan`` into the arrays of `Elsewhere`, by their names."""
    inputs = [link for one in plan.instances for link in one.inputs]
    outputs = [link for one in plan.instances for link in one.outputs]
    for links, references, places, scales in (
        (inputs, "input_references", "fed", "feed_scale"),
        (outputs, "output_references", "taken", "take_scale"),
    ):
        numbers[references][:] = [link.reference for link in links]
        numbers[places][:] = [link.place for link in links]
        numbers[scales][:] = [(link.scale, link.zero) for link in links]
