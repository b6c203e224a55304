"""The bench with two air springs as a system for mapped files: it defines the signals that a replay needs from files of
another rig.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench_protocol.signals import Group
from bench_protocol.table_signals import BY_GROUP
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.rest import settled_temperature
from bench_sim.parameters import Parameters
from diagnosis.contracts import Array, Channel
from diagnosis.systems.air_spring.gas import GAS
from diagnosis.systems.air_spring.simulator import AirSpring, channels
from diagnosis.systems.motion import motion_inputs, scatter
from diagnosis.systems.system import System, SystemSetting, SystemSignal

#: A replay begins with these pressures.
_BEGIN: Final = ("left.bellows_pressure", "right.bellows_pressure")
_VALVES: Final = ("left.leveling", "right.leveling", "left.reservoir", "right.reservoir", "dpv")
#: Heights and platform, which must not move at rest.
_PLACES: Final = (
    *BY_GROUP[Group.HEIGHT],
    *BY_GROUP[Group.PLATFORM_DISPLACEMENT],
    *BY_GROUP[Group.PLATFORM_ROLL],
)
#: Slower than this (m/s, rad/s) for half a second is rest.
_REST_SPEED: Final = 0.2e-3
#: Number of samples whose median gives the start of a run.
_FIRST: Final = 5


def air_spring_system(parameters: Parameters) -> System:
    """Return the system of two air springs with a parameter set. Heights are its inputs, pressures and forces its
    outputs.
    """

    def simulator(settings: Mapping[str, float], measured: tuple[Channel, ...]) -> AirSpring:
        there = parameters.with_values(atmospheric_pressure=settings["ambient_pressure"])
        return AirSpring(there, effects=CATALOGUE, only=tuple(channel.name for channel in measured))

    def prepare(step: float, clock: Array, measured: Mapping[str, Array]) -> Mapping[str, Array]:
        inputs = motion_inputs(measured, step, parameters)
        return inputs | {name: measured[name] for name in _VALVES if name in measured} | _supply(measured)

    return System(
        name="air_spring",
        title="two air springs under a bolster: their motion is measured, pressures and forces are predicted",
        inputs=_INPUTS,
        outputs=_outputs(parameters),
        settings=_settings(parameters),
        simulator=simulator,
        prepare=prepare,
        rest=_at_rest,
        begin=_start_gas,
    )


def _millimetres(name: str, title: str, required: bool = False) -> SystemSignal:
    return SystemSignal(name, "m", title, required, display="mm", scale=1e-3)


_INPUTS: Final = (
    _millimetres("left.height", "change of the height of the left spring", required=True),
    _millimetres("right.height", "change of the height of the right spring", required=True),
    _millimetres("lateral.displacement", "lateral displacement of the bolster"),
    _millimetres("platform.vertical", "vertical displacement of the platform"),
    _millimetres("platform.lateral", "lateral displacement of the platform"),
    SystemSignal("platform.roll", "rad", "roll of the platform", required=False, display="mrad", scale=1e-3),
    SystemSignal("lateral.acceleration", "m/s2", "lateral acceleration of the bolster", required=False),
    SystemSignal("supply.pressure", "Pa", "pressure of the air supply", required=False, gauge=True),
    *(SystemSignal(name, "1", f"opening of the valve {name}", required=False) for name in _VALVES),
)


def _outputs(parameters: Parameters) -> tuple[SystemSignal, ...]:
    return tuple(
        SystemSignal(
            channel.name,
            channel.unit,
            channel.name.replace(".", ", ").replace("_", " "),
            required=channel.name in _BEGIN,
            gauge=channel.unit == "Pa",
            display=channel.display,
            scale=channel.scale,
        )
        for channel in channels(parameters)
    )


def _settings(parameters: Parameters) -> tuple[SystemSetting, ...]:
    par = parameters.record
    preload, bore, pipe = (
        float(par[name][0]) for name in ("nominal_preload", "orifice_diameter", "pipe_length")
    )
    ambient = float(par.atmospheric_pressure)
    wall = float(settled_temperature(par))
    return (
        SystemSetting("nominal_preload", "N", "load on a spring", 1e3, 1e6, preload, True),
        SystemSetting("orifice_diameter", "m", "bore of the orifice", 1e-4, 0.2, bore, True),
        SystemSetting("pipe_length", "m", "length of the pipe, 0 without", 0.0, 20.0, pipe, True),
        SystemSetting("ambient_pressure", "Pa", "pressure of the air around", 8e4, 1.1e5, ambient),
        SystemSetting(
            "wall_temperature",
            "K",
            "temperature of the springs' walls where a run begins",
            230.0,
            390.0,
            wall,
            True,
        ),
    )


def _supply(measured: Mapping[str, Array]) -> dict[str, Array]:
    return {name: measured[name] for name in ("supply.pressure",) if name in measured}


def _at_rest(step: float, clock: Array, measured: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Return a mask (n,): True where all heights and platform motions are at rest, by their scatter within half a
    second.

    A difference over half a second would not do: it is 0 at each reversal, and always 0 at 2 Hz.
    """
    half = max(round(0.25 / step), 1)
    least = _REST_SPEED * 2 * half * step / np.sqrt(12.0)
    still = np.ones(len(clock), dtype=np.bool_)
    for name, values in measured.items():
        if name in _PLACES:
            known = np.isfinite(values)
            off = (
                np.where(known, values - values[known].mean(), 0.0) if known.any() else np.zeros(len(values))
            )
            still &= scatter(known, off, off**2, 2 * half + 1) < least
    return still


def _start_gas(measured: Mapping[str, Array]) -> Mapping[str, float]:
    """Return pressures (Pa) and temperatures (K) of the gas at the start of a run: medians of the first measured
    samples.
    """
    found = {}
    for name in GAS:
        if name in measured:
            known = measured[name][np.isfinite(measured[name])]
            if len(known):
                found[name] = float(np.median(known[:_FIRST]))
    return found
