"""The parameters in which a bench may differ from its parameter set, and the effects that its model may lack."""

import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from math import log, sqrt
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from bench_sim.model.effects import effect as bench
from bench_sim.model.layout import Sensor
from bench_sim.model.quantities import QUANTITIES
from bench_sim.parameters import Parameters
from diagnosis.contracts import Channel, Hypothesis, Nuisance, Parameter

#: Geometry and materials that differ between springs, with the relative standard deviation of a good delivery. A value
#: has one parameter for each side if load cells measure its effect for each spring. The lateral cells measure the sum
#: of both.
EACH_SIDE: Final[Mapping[str, float]] = MappingProxyType(
    {
        "effective_area": 0.01,
        "effective_area_slope": 0.1,
        "bellows_volume": 0.01,
        "auxiliary_volume": 0.005,
        "discharge_coefficient": 0.015,
        "shell_stiffness_vertical": 0.1,
    }
)
BOTH_SIDES: Final[Mapping[str, float]] = MappingProxyType(
    {"membrane_length": 0.05, "shell_stiffness_lateral": 0.1}
)
#: The same for the leveling valves, and the accuracy (m) of the adjustment of their lever rods. The zero of a laser
#: says nothing about the zero of a valve.
VALVES: Final[Mapping[str, float]] = MappingProxyType({"fill_conductance": 0.05, "exhaust_conductance": 0.05})
LEVER: Final = "lever_offset"
LEVER_ADJUSTMENT: Final = 0.5e-3
_OF_VALVES: Final = frozenset({*VALVES, LEVER})
#: The signal of the gauge whose unknown zero adds to the uncertainty of the air that the valves let in.
SUPPLY: Final = "supply.pressure"
#: Uncertainty of the gas at the start of a run, from the first second of rest. It includes the end of a line through a
#: hundred readings (40 Pa for white noise, 150 Pa for an autocorrelation of 0.9) and errors of the thermometers.
INITIAL_PRESSURE: Final = 150.0
INITIAL_TEMPERATURE: Final = 0.2

#: Parameters of effects in words, where the name of the parameter is not clear beside the title of the effect.
_TITLES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "maxwell.ratio": "stiffness of the branch / stiffness of the shell",
        "maxwell.time": "time constant",
        "maxwell_two.ratio": "stiffness of both branches / stiffness of the shell",
        "maxwell_two.time_fast": "short time constant",
        "maxwell_two.time_slow": "long time constant",
        "maxwell_two.share": "share of the first branch",
        "fractional.ratio": "stiffness at 1 Hz / stiffness of the shell",
        "friction.force": "friction limit",
        "friction_distributed.force": "friction limit",
        "friction_distributed.share": "share of the element with short travel",
        "creep.ratio": "creep / deflection",
        "creep.time": "time constant",
        "discharge_reynolds.k": "k in C_d = C_d∞/(1 + k/√Re)",
        "blocked_orifice.share": "reduction of the discharge coefficient",
        "crosstalk.share": "measured share of the vertical force",
        "sample_and_hold.hold": "hold (100 %: constant between samples)",
        "seat_offset.ahead": "lengthwise offset",
        "load_offset.ahead": "lengthwise offset",
        "soft_support.softer": "additional compliance of the support",
        "twisted_seat.force": "change of the force of each load cell",
        "coupling.error": "relative change of the coupling stiffness",
        "emergency_compliance.error": "relative change of the compliance",
    }
)
#: Results of sound benches: the amplitude of each effect that their replay imitates, at each point of its grid, and the
#: overdispersion of its directions.
SOUND: Final = Path(__file__).with_name("sound_benches.toml")
#: Suffix and spread (m) of an apparent shift in one run, of an actuator or of the shear. The bus rounds the platform's
#: transducers to 10 µm, and while the platform rests, the rounding error is the same for the whole run. In the shear it
#: also represents the effect of earlier motions on friction.
SEAT: Final = ".seat"
ROUNDING: Final = 3e-6
#: Suffix and spread (N s/m) of a force proportional to speed that the transducer of an actuator shows, but that does
#: not act on the bolster: friction of seals. In the virtual rig it comes from set-points that wait for the next tick
#: Δt. Between ticks the piston lags and catches up; at a tick, when sensors are read, the damper of the frame shows c
#: ω² Δt²/12 = 103 N s/m more than on average.
DRAG: Final = ".drag"
SEALS: Final = 100.0
#: The transducer whose offset counts as an offset of the shear, which changes the forces of the springs.
SHEAR: Final = "lateral.displacement"
#: The chambers, each with its own temperature.
AUXILIARY: Final = ("left.auxiliary", "right.auxiliary")
CHAMBERS: Final = ("left.bellows", "right.bellows", *AUXILIARY)

#: Steps of finite differences, relative to standard deviations and typical sizes. The places where friction reverses
#: depend on its history, and a reversal that appears or disappears is a jump. The larger the step, the smaller its
#: effect.
_STEP: Final = 0.1
_SIDES: Final = bench.PLACES
_UNITS: Final = {quantity.name: quantity.unit for quantity in QUANTITIES}


def nuisances(parameters: Parameters, measured: tuple[tuple[Channel, Sensor], ...]) -> tuple[Nuisance, ...]:
    """Return the nuisances of every model: zeros and drag of the sensors, the gas at the start, then the springs.

    Zeros come first because they need no separate simulation. ``measured`` lists the channels, each with its sensor.
    """
    return (
        *_offsets(parameters, measured),
        *_rounding_errors(measured),
        *_drags(measured),
        *_initial_gas(),
        *_tolerances(parameters),
        *_leveling(parameters),
    )


def _nuisance(name: str, unit: str, spread: float, display: str = "", scale: float = 1.0) -> Nuisance:
    """Return a nuisance with nominal value 0 and standard deviation ``spread``."""
    return Nuisance(name, unit, 0.0, spread, step=_STEP * spread, display=display, scale=scale)


def _offsets(parameters: Parameters, measured: tuple[tuple[Channel, Sensor], ...]) -> Iterator[Nuisance]:
    """Yield the zeros of the sensors. The accuracy of a data sheet is the bound of a uniform distribution, so σ is
    accuracy/√3.
    """
    accuracy = parameters.record.sensor_accuracy / sqrt(3.0)
    accuracy[[Sensor.VERTICAL_LEFT_DISPLACEMENT, Sensor.VERTICAL_RIGHT_DISPLACEMENT]] = _pin_accuracy(
        parameters
    )
    for channel, sensor in measured:
        spread = float(accuracy[sensor])
        yield _nuisance(f"{channel.name}.offset", channel.unit, spread, channel.display, channel.scale)
    yield _nuisance(f"{SHEAR}.offset", "m", _shear_accuracy(parameters), "mm", 1e-3)


def _rounding_errors(measured: tuple[tuple[Channel, Sensor], ...]) -> Iterator[Nuisance]:
    """Yield offsets of displacements that are constant in one run. They are due to the resolution of transducers at
    rest.
    """
    shear = _nuisance(f"{SHEAR}{SEAT}", "m", ROUNDING, "mm", 1e-3)
    yield replace(shear, per_run=True)
    for channel, _ in measured:
        if channel.kind == "displacement":
            one = _nuisance(f"{channel.name}{SEAT}", channel.unit, ROUNDING, channel.display, channel.scale)
            yield replace(one, per_run=True)


def _drags(measured: tuple[tuple[Channel, Sensor], ...]) -> Iterator[Nuisance]:
    """Yield forces proportional to speed that act on the transducers of the actuators, but not on the springs."""
    for channel, sensor in measured:
        if Sensor.VERTICAL_LEFT_FORCE <= sensor <= Sensor.LATERAL_FORCE:
            yield _nuisance(f"{channel.name}{DRAG}", "N*s/m", SEALS)


def _initial_gas() -> Iterator[Nuisance]:
    """Yield the pressure of each spring and the temperature of each chamber at the start of a run.

    A closed auxiliary chamber has its own pressure.
    """
    for place in (*_SIDES, *AUXILIARY):
        pressure = _nuisance(f"{place}.initial_pressure", "Pa", INITIAL_PRESSURE, "mbar", 100.0)
        yield replace(pressure, per_run=True)
    for chamber in CHAMBERS:
        temperature = _nuisance(f"{chamber}.initial_temperature", "K", INITIAL_TEMPERATURE, "K")
        yield replace(temperature, per_run=True)


def _tolerances(parameters: Parameters) -> Iterator[Nuisance]:
    """Yield geometry and materials of the springs. Parameters that differ between the sides have one value for each
    side.
    """
    for name, share in EACH_SIDE.items():
        for place, side in enumerate(_SIDES):
            yield _tolerance(parameters, name, f"{side}.{name}", place, share)
    for name, share in BOTH_SIDES.items():
        yield _tolerance(parameters, name, name, 0, share)


def _leveling(parameters: Parameters) -> Iterator[Nuisance]:
    """Yield parameters of the leveling valves, which have an effect only while these work, and the zero of the supply's
    gauge.
    """
    accuracy = float(parameters.record.sensor_accuracy[Sensor.SUPPLY_PRESSURE])
    yield _nuisance(f"{SUPPLY}.offset", "Pa", accuracy / sqrt(3.0), "mbar", 100.0)
    for place, side in enumerate(_SIDES):
        for name, share in VALVES.items():
            yield _tolerance(parameters, name, f"{side}.{name}", place, share)
        lever = _nuisance(f"{side}.{LEVER}", "m", LEVER_ADJUSTMENT, "mm", 1e-3)
        yield replace(lever, nominal=float(parameters.entries[LEVER].value[place]))


def zeros_of_heights(parameters: Parameters) -> tuple[dict[str, float], ...]:
    """Return for each laser how one standard deviation of its zero changes the apparent parameters of the springs.

    If ζ is read too high by b, V = V_0 + (A_0 + A_1 ζ/2) ζ − (κ_0 + κ_1 ζ) Y/2 is that of another spring: its A_0 is
    smaller by A_1 b, V_0 by A_0 b and κ_0 by κ_1 b. Load-cell zeros absorb the error of the shell's force.
    """
    par = parameters.record
    errors = []
    for place, side in enumerate(_SIDES):
        zero = float(par.sensor_accuracy[Sensor.LEFT_HEIGHT + place]) / sqrt(3.0)
        errors.append(
            {
                f"{side}.effective_area": -float(par.effective_area_slope[place]) * zero,
                f"{side}.bellows_volume": -float(par.effective_area[place]) * zero,
                "membrane_length": -0.5 * float(par.membrane_length_slope[place]) * zero,
            }
        )
    return tuple(errors)


def _pin_accuracy(parameters: Parameters) -> float:
    """Return the standard deviation (m) of the offset of a vertical actuator's transducer, relative to the motion
    sensors.

    The bolster is at (ζ_L + ζ_R)/2 + z_P + a ((ζ_L − ζ_R)/2b + φ_P) at the pin of an actuator, and each of these
    sensors has its own zero.
    """
    par = parameters.record
    arm = par.actuator_half_spacing
    ratio = arm / par.spring_half_spacing
    shares = (
        (Sensor.VERTICAL_LEFT_DISPLACEMENT, 1.0),
        (Sensor.LEFT_HEIGHT, 0.5 * (1.0 + ratio)),
        (Sensor.RIGHT_HEIGHT, 0.5 * (1.0 - ratio)),
        (Sensor.PLATFORM_VERTICAL, 1.0),
        (Sensor.PLATFORM_ROLL, arm),
    )
    return sqrt(sum((share * par.sensor_accuracy[sensor]) ** 2 for sensor, share in shares) / 3.0)


def _shear_accuracy(parameters: Parameters) -> float:
    """Return the standard deviation (m) of the offset of the shear, from the offsets of the sensors used to
    compute it.
    """
    par = parameters.record
    arm = par.lateral_actuator_height + par.centre_height
    shares = (
        (Sensor.LATERAL_DISPLACEMENT, 1.0),
        (Sensor.PLATFORM_LATERAL, 1.0),
        (Sensor.LEFT_HEIGHT, 0.5 * arm / par.spring_half_spacing),
        (Sensor.RIGHT_HEIGHT, 0.5 * arm / par.spring_half_spacing),
        (Sensor.PLATFORM_ROLL, arm + par.column_height),
    )
    return sqrt(sum((share * par.sensor_accuracy[sensor]) ** 2 for sensor, share in shares) / 3.0)


def _tolerance(parameters: Parameters, name: str, label: str, place: int, share: float) -> Nuisance:
    return tolerance(parameters, name, label, place, share, _STEP * share)


def tolerance(
    parameters: Parameters, name: str, label: str, place: int, share: float, step: float
) -> Nuisance:
    """Return one element of a parameter of the set as a nuisance. Its standard deviation is ``share`` times its value.

    ``step`` is the step of finite differences, also as a share of the value.
    """
    entry = parameters.entries[name]
    value = float(entry.value[place])
    return Nuisance(
        label,
        _UNITS[name],
        value,
        share * abs(value),
        float(entry.low[place]),
        float(entry.high[place]),
        step * abs(value),
        display=entry.unit,
        scale=entry.scale,
    )


def deviate(record: Any, values: Mapping[str, float], *, leveling: bool) -> None:
    """Write the values of spring parameters into a parameter record; with ``leveling`` also those of the leveling
    valves.

    A name with a side as prefix is for that side, a name without it for both. Other names are skipped.
    """
    for label, value in values.items():
        side, _, name = label.rpartition(".")
        if name not in _UNITS or (name in _OF_VALVES and not leveling):
            continue
        if not side:
            record[name][:] = value
        elif side in _SIDES:
            record[name][_SIDES.index(side)] = value


def hypotheses(effects: Mapping[str, bench.Effect], possible: Callable[[str], bool]) -> dict[str, Hypothesis]:
    """Return the ``possible`` effects of the bench as candidate causes, one for every place, such as ``leak.left``."""
    causes = {
        name: (effect, place)
        for effect in effects.values()
        if effect.diagnosable
        for place in effect.places or ("",)
        for name in (_label(effect.name, place),)
        if possible(name)
    }

    def possible_at(names: tuple[str, ...], place: str) -> tuple[str, ...]:
        return tuple(name for name in _labels_at(names, place, effects) if name in causes)

    return {
        name: _hypothesis(
            name, effect, place, possible_at(effect.confusers, place), possible_at(effect.richer, place)
        )
        for name, (effect, place) in causes.items()
    }


def locate(name: str, effects: Mapping[str, bench.Effect]) -> tuple[bench.Effect, int | None]:
    """Return the effect of the bench for the name of a cause, and the index of its side. Raises KeyError for an unknown
    name.
    """
    root, _, place = name.partition(".")
    return effects[root], effects[root].places.index(place) if place else None


def _label(name: str, place: str) -> str:
    return f"{name}.{place}" if place else name


def _hypothesis(
    name: str, effect: bench.Effect, place: str, confusers: tuple[str, ...], richer: tuple[str, ...]
) -> Hypothesis:
    amplitude, imitated = effect.amplitude, tuple(_sound()["imitated"].get(effect.name, ()))
    return Hypothesis(
        name,
        effect.family,
        f"{effect.title}, {place}" if place else effect.title,
        Parameter(
            amplitude.name,
            amplitude.unit,
            amplitude.nominal,
            amplitude.typical,
            amplitude.low,
            amplitude.high,
            _STEP * amplitude.typical,
            display=amplitude.display,
            scale=amplitude.scale,
            title=_title(effect, amplitude),
        ),
        tuple(_shape(effect, shape) for shape in effect.shapes),
        effect.grid,
        effect.touches,
        confusers,
        richer,
        effect.equation,
        effect.source,
        imitated=imitated if len(imitated) == len(effect.grid) else (),
        overdispersion=_sound()["overdispersion"].get(effect.name, 1.0),
        plain=effect.plain.format(side=place),
        phenomenon=effect.phenomenon.format(side=place),
        separated_by=effect.separated_by,
    )


@cache
def _sound() -> dict[str, dict[str, Any]]:
    return tomllib.loads(SOUND.read_text(encoding="utf-8"))


def _title(effect: bench.Effect, parameter: bench.EffectParameter) -> str:
    """Return a parameter of an effect in words; "" if its name is clear."""
    return _TITLES.get(f"{effect.name}.{parameter.name}", "")


def _shape(effect: bench.Effect, shape: bench.EffectParameter) -> Parameter:
    """Return a shape parameter. Its standard deviation is a quarter of the range (of the logarithm, if logarithmic)."""
    width = shape.nominal * log(shape.high / shape.low) if shape.logarithmic else shape.high - shape.low
    return Parameter(
        shape.name,
        shape.unit,
        shape.nominal,
        0.25 * width,
        shape.low,
        shape.high,
        logarithmic=shape.logarithmic,
        display=shape.display,
        scale=shape.scale,
        title=_title(effect, shape),
    )


def _labels_at(names: tuple[str, ...], place: str, effects: Mapping[str, bench.Effect]) -> tuple[str, ...]:
    """Return the labels of effects at the same place. If an effect does not have this place, return all its places."""
    return tuple(
        _label(name, where)
        for name in names
        if name in effects
        for where in (effects[name].places or ("",))
        if where in {place, ""} or not place
    )
