"""Maps variables of an FMU to quantities of a spring. Checks the names, units and signs of the map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace as with_keys

from bench_protocol.rates import TICK
from bench_protocol.suggestion import did_you_mean
from bench_protocol.unit_names import base_exponents
from bench_protocol.units import ATMOSPHERE, UNITS, WRITTEN_UNITS
from bench_protocol.words import SIDES
from bench_protocol.written_values import NotAValue, read_written
from bench_sim.fmu.description import REALS, Fmu, FmuError, Variable, without_angles
from bench_sim.model.algebraic import Algebraic
from bench_sim.model.external_springs import SUPPLY_TAKEN, Feed, Hold
from bench_sim.rig.spring_fmu.keys import TIMEOUT_MAX, SpringMap, VariableKeys

#: Inputs of one spring: unit, place on the left, and distance to the place on the right.
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
#: Names of inputs that both springs share, in an instance for both.
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
#: Outputs of one spring: unit, and place on the left.
_TAKEN: Final = {
    "vertical_force": ("N", Algebraic.VERTICAL_FORCE),
    "lateral_force": ("N", Algebraic.LATERAL_FORCE),
    "roll_moment": ("N*m", Algebraic.ROLL_MOMENT),
    "bellows_pressure": ("Pa", Algebraic.PRESSURE),
    "auxiliary_pressure": ("Pa", Algebraic.AUXILIARY_PRESSURE),
    "bellows_temperature": ("K", Algebraic.TEMPERATURE),
    "auxiliary_temperature": ("K", Algebraic.AUXILIARY_TEMPERATURE),
}
#: Inputs by which air enters a spring.
_AIR: Final = ("air_flow", "leveling", "service_valve")
_NEEDED: Final = ("vertical_force", "bellows_pressure")
#: Parameter with which an FMU without a map starts without air, as the rig does.
_WITHOUT_AIR: Final = "air.at_start"


@dataclass(frozen=True, slots=True)
class Link:
    """A variable of one instance and the conversion of its value. An input is ``scale`` · SI + ``zero``. The SI value
    of an output is ``scale`` · output + ``zero``.
    """

    name: str
    reference: int
    place: int
    scale: float
    zero: float


@dataclass(frozen=True, slots=True)
class Instance:
    """One instance of the FMU. ``parameters`` are pairs (reference, number) that are set before its initialization."""

    name: str
    inputs: tuple[Link, ...]
    outputs: tuple[Link, ...]
    parameters: tuple[tuple[int, float], ...]


@dataclass(frozen=True, slots=True)
class Coupling:
    """The connection of an FMU that replaces both springs. ``notes`` are sentences for the user."""

    fmu: Fmu
    instances: tuple[Instance, ...]
    ticks: int  #: of one communication step
    hold: Hold
    valves: bool  #: the bench's valves feed the springs
    timeout: float  #: s
    apart: bool
    notes: tuple[str, ...]

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Return the numbers of instances, inputs, and outputs."""
        inputs = sum(len(one.inputs) for one in self.instances)
        return len(self.instances), inputs, sum(len(one.outputs) for one in self.instances)


def coupling_of(fmu: Fmu, keys: SpringMap, ambient: float) -> Coupling:
    """Return the connection of ``fmu`` that replaces the springs. If the FMU has no output for a gas temperature, it
    is ``ambient`` (K).

    Raises FmuError, whose text names the key of the map.
    """
    own = not keys.inputs and not keys.outputs
    if own:
        keys = _own_names(fmu, keys)
    both = _both_sides(keys)
    sides = (("", None),) if both else tuple((side, place) for place, side in enumerate(SIDES))
    notes: list[str] = []
    instances = tuple(_instance(fmu, keys, side, place, ambient, notes) for side, place in sides)
    _check_complete(fmu, keys, instances)
    known = {name.rpartition(".")[2] for name in keys.inputs}
    if not known & set(_AIR):
        raise FmuError(
            f"{fmu.path.name} has no air flow: spring_map.inputs has none of {', '.join(_AIR)}; map "
            "the air flow of the bench's valves, or the openings of the FMU's valves"
        )
    ticks = _ticks(fmu, keys)
    timeout = _seconds("spring_map.patience", keys.patience, TIMEOUT_MAX)
    hold = Hold.BEGIN if own else Hold[keys.hold.upper()]
    valves = "air_flow" in known
    return Coupling(fmu, instances, ticks, hold, valves, timeout, keys.process == "own", tuple(notes))


def _own_names(fmu: Fmu, keys: SpringMap) -> SpringMap:
    """Return the map of an FMU whose variables have the names of the bench."""
    known = fmu.variables
    inputs = {name: name for name in _fed_names() if name in known and _is_input(known[name])}
    outputs = {name: name for name in _taken_names() if name in known and known[name].causality == "output"}
    needed = [f"{side}.{name}" for name in ("height", *_NEEDED) for side in SIDES]
    if missing := [name for name in needed if name not in inputs and name not in outputs]:
        output = next((one.name for one in known.values() if one.causality == "output"), "F")
        raise FmuError(
            f"{fmu.path.name} has no variables {', '.join(missing)}; map the bench's names to those of the FMU in "
            f'spring_map, such as outputs.vertical_force = "{output}"'
        )
    parameters = dict(keys.parameters)
    if _WITHOUT_AIR in known:
        parameters.setdefault(_WITHOUT_AIR, 0.0)
    pressures = (*(name for name in outputs if name.endswith("_pressure")), "supply.pressure")
    return with_keys(
        keys, inputs=inputs, outputs=outputs, parameters=parameters, gauge=(*keys.gauge, *pressures)
    )


def _is_input(one: Variable) -> bool:
    return one.causality == "input" or (one.causality == "parameter" and one.variability == "tunable")


def _fed_names() -> dict[str, tuple[str, int]]:
    """Return unit and index of each input, by name, for an instance that computes both springs."""
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
    """Return unit and index of each output, by name, for an instance that computes both springs."""
    names = {
        f"{word}.{name}": (unit, int(place) + side)
        for name, (unit, place) in _TAKEN.items()
        for side, word in enumerate(SIDES)
    }
    return names | {"supply.pressure": ("Pa", SUPPLY_TAKEN)}


def _both_sides(keys: SpringMap) -> bool:
    """Return whether one instance computes both springs. Raises FmuError if both kinds of names are mixed."""
    kinds = {("." in name) for name in (*keys.inputs, *keys.outputs)}
    if len(kinds) == 2:
        raise FmuError(
            "spring_map mixes names of one spring, such as height, with names of both, such as left.height; use the "
            "former for one instance per side, or the latter for one instance of both springs"
        )
    return kinds == {True}


def _instance(
    fmu: Fmu, keys: SpringMap, side: str, place: int | None, ambient: float, notes: list[str]
) -> Instance:
    """Return the instance for one ``side``, or for both springs if ``side`` is ""."""
    if place is None:
        fed, taken = _fed_names(), _taken_names()
    else:
        fed = {name: (unit, int(where) + one * place) for name, (unit, where, one) in _FED.items()}
        taken = {name: (unit, int(where) + place) for name, (unit, where) in _TAKEN.items()}
    inputs = tuple(_link(fmu, keys, "inputs", name, entry, fed) for name, entry in keys.inputs.items())
    outputs = [_link(fmu, keys, "outputs", name, entry, taken) for name, entry in keys.outputs.items()]
    outputs += _assumed(fmu, outputs, taken, ambient, notes)
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
    """Return the conversion for one line of the map."""
    where = f"spring_map.{kind}.{name}"
    if name not in known:
        raise FmuError(f"{where}: the bench has no such quantity; {did_you_mean(name, known)}")
    si, place = known[name]
    given = VariableKeys(entry) if isinstance(entry, str) else entry
    variable = fmu.variable(given.variable, where)
    _check_kind(variable, kind, where)
    factor, zero = _scale(variable, given.unit, si, where)
    if si == "Pa" and variable.name not in keys.gauge:
        zero -= ATMOSPHERE  # the bench uses gauge pressures
    if kind == "inputs":
        return Link(variable.name, variable.reference, place, given.factor / factor, -zero / factor)
    return Link(variable.name, variable.reference, place, factor / given.factor, zero)


def _check_kind(variable: Variable, kind: str, where: str) -> None:
    if variable.type not in REALS - {"Float32"}:
        raise FmuError(
            f"{where}: {variable.name} has the type {variable.type}; use a variable of the type Real (FMI 2) or "
            "Float64 (FMI 3)"
        )
    fits = _is_input(variable) if kind == "inputs" else variable.causality in {"output", "local"}
    if not fits:
        use = "an input or a tunable parameter" if kind == "inputs" else "an output or a local variable"
        raise FmuError(f"{where}: {variable.name} is {variable.causality} in the FMU; use {use}")


def _scale(variable: Variable, unit: str, si: str, where: str) -> tuple[float, float]:
    """Return the factor and zero of a variable: SI = factor · number + zero."""
    if unit and unit not in UNITS:
        raise FmuError(f'{where}: unit = "{unit}" is unknown; use {_units(si)}')
    if unit and base_exponents(UNITS[unit].si) != base_exponents(si):
        raise FmuError(f'{where}: unit = "{unit}" is not a unit of this quantity; use {_units(si)}')
    own = variable.unit
    if not own.name:
        return (UNITS[unit].factor, UNITS[unit].zero) if unit else (1.0, 0.0)
    if without_angles(own.exponents) != without_angles(base_exponents(si)):
        raise FmuError(
            f'{where}: {variable.name} has the unit "{own.name}" in the FMU, which is not a unit of '
            f"this quantity; use a variable in {_units(si)}"
        )
    if unit and (UNITS[unit].factor, UNITS[unit].zero) != (own.factor, own.zero):
        raise FmuError(
            f'{where}: unit = "{unit}" contradicts the FMU, in which {variable.name} has the unit "{own.name}"; '
            "remove unit from the map"
        )
    return own.factor, own.zero


def _units(si: str) -> str:
    return " or ".join(name for name, one in WRITTEN_UNITS.items() if one.si == si)


def _assumed(
    fmu: Fmu, outputs: list[Link], taken: Mapping[str, tuple[str, int]], ambient: float, notes: list[str]
) -> list[Link]:
    """Return links for missing outputs: auxiliary pressure as in the bellows, ambient temperature, and no force. A
    note on each is added to ``notes``.
    """
    mapped = {one.place: one for one in outputs}
    assumed = []
    for name, (si, place) in taken.items():
        base = name.rpartition(".")[2]
        if place in mapped or place == SUPPLY_TAKEN or base in _NEEDED:
            continue
        any_other = outputs[0].reference if outputs else 0
        if base == "auxiliary_pressure":
            same = mapped.get(place - Algebraic.AUXILIARY_PRESSURE + Algebraic.PRESSURE)
            if same is not None:
                assumed.append(replace(same, name=name, place=place))
            text = "the pressure of the bellows"
        else:
            value = ambient if si == "K" else 0.0
            assumed.append(Link(name, any_other, place, 0.0, value))
            text = f"{value:g} {si}"
        line = f"{fmu.path.name} has no output {base}: {text} is assumed"
        if line not in notes:
            notes.append(line)
    return assumed


def _check_complete(fmu: Fmu, keys: SpringMap, instances: tuple[Instance, ...]) -> None:
    """Raise FmuError if the map has no height, force or pressure of a spring."""
    fed = {link.place for one in instances for link in one.inputs}
    taken = {link.place for one in instances for link in one.outputs}
    missing = [f"inputs.{side}.height" for k, side in enumerate(SIDES) if Feed.HEIGHT + k not in fed]
    missing += [
        f"outputs.{side}.{name}"
        for name in _NEEDED
        for k, side in enumerate(SIDES)
        if _TAKEN[name][1] + k not in taken
    ]
    if missing:
        if not _both_sides(keys):
            missing = [one.replace(".left.", ".").replace(".right.", ".") for one in missing]
        names = ", ".join(dict.fromkeys(missing))
        raise FmuError(f"spring_map of {fmu.path.name} lacks {names}; map it to a variable of the FMU")


def _parameters(fmu: Fmu, given: Mapping[str, str | int | float], side: str) -> list[tuple[int, float]]:
    """Return (reference, number) of each parameter of this instance. ``left.x`` is the parameter x of the left
    spring.
    """
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
            raise FmuError(
                f"{where}: {name} has the type {variable.type} and the causality {variable.causality}; use a real "
                "parameter"
            )
        number = _number(variable, value, where)
        if not variable.low <= number <= variable.high:
            raise FmuError(
                f"{where} = {value!r} is outside the bounds of the FMU; use a value from {variable.low:g} to "
                f"{variable.high:g} {variable.unit.name}"
            )
        found.append((variable.reference, number))
    return found


def _number(variable: Variable, value: str | int | float, where: str) -> float:
    if not isinstance(value, str):
        return float(value)
    try:
        return variable.unit.from_si(read_written(where, value, variable.unit.si or "1"))
    except NotAValue as error:
        raise FmuError(str(error)) from None


def _ticks(fmu: Fmu, keys: SpringMap) -> int:
    """Return the number of ticks of a communication step."""
    step = _seconds("spring_map.step", keys.step, 1.0) if keys.step else TICK
    ticks = round(step / TICK)
    if ticks < 1 or abs(ticks * TICK - step) > 1e-9:
        raise FmuError(
            f'spring_map.step = "{keys.step}" is not a whole number of ticks; use a multiple of '
            f"{TICK * 1e3:g} ms"
        )
    if fmu.step is not None and not fmu.variable_steps:
        parts = ticks * TICK / fmu.step
        if round(parts) < 1 or abs(parts - round(parts)) > 1e-6:
            raise FmuError(
                f"spring_map.step is {ticks * TICK * 1e3:g} ms, but {fmu.path.name} has a fixed step; use a multiple "
                f"of {fmu.step * 1e3:g} ms"
            )
    return ticks


def _seconds(what: str, text: str, most: float) -> float:
    try:
        value = read_written(what, text, "s")
    except NotAValue as error:
        raise FmuError(str(error)) from None
    if not 0.0 < value <= most:
        raise FmuError(
            f'{what} = "{text}" is outside the range; use a time of more than 0 and at most {most:g} s'
        )
    return value


def fill(numbers: Mapping[str, npt.NDArray[np.float64]], coupling: Coupling) -> None:
    """Write references, indices and scales of ``coupling`` to the arrays of `ExternalSprings`, which are given by
    name.
    """
    inputs = [link for one in coupling.instances for link in one.inputs]
    outputs = [link for one in coupling.instances for link in one.outputs]
    for links, references, places, scales in (
        (inputs, "input_references", "fed", "feed_scale"),
        (outputs, "output_references", "taken", "take_scale"),
    ):
        numbers[references][:] = [link.reference for link in links]
        numbers[places][:] = [link.place for link in links]
        numbers[scales][:] = [(link.scale, link.zero) for link in links]
