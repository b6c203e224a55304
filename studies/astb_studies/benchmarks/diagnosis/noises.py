"""The noise of the benchmark's conditions: the noise of a sealed bench, and the noise model for its λ."""

from collections.abc import Mapping
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from bench_sim.model.wiring import FORCES, PRESSURES
from bench_sim.parameters import Parameters
from diagnosis.contracts import Channel
from diagnosis.engine.noise import ChannelNoise, Noise
from diagnosis.systems.air_spring.simulator import OUTPUTS, channels

Condition = Literal["white", "AR 0.6", "AR 0.9", "12 bits", "frames lost", "sibling"]
#: The measured outputs without the signals of the motion: these sensors have coloured noise.
COLOURED: Final = [*FORCES, *PRESSURES]
COLOURS: Final[Mapping[Condition, float]] = {"AR 0.6": 0.6, "AR 0.9": 0.9}
BITS: Final = 2.0**-12
#: Fraction of lost frames.
LOST: Final = 0.1


def of_twelve_bits(bench: Parameters) -> NDArray[np.float64]:
    """Return the resolutions (SENSORS,) of sensors with coarse converters, in whole steps of the wire.

    Other steps would be rounded twice. The sum of both errors is a sawtooth over kilonewtons, ± 12.5 N at the load
    cells. This is a nonlinearity of the sensor, not noise.
    """
    span = bench.entries["sensor_high"].value - bench.entries["sensor_low"].value
    coarse = bench.entries["sensor_resolution"].value.copy()
    for channel in channels(bench):
        sensor = OUTPUTS[channel.name]
        if sensor in COLOURED:
            coarse[sensor] = np.rint(BITS * span[sensor] / channel.resolution) * channel.resolution
    return coarse


def noise_of(condition: Condition, bench: Parameters) -> Noise:
    """Return the noise of the channels of a bench under a condition, with the rounding of its converters."""
    coarse = of_twelve_bits(bench)
    return Noise(tuple(_of_channel(channel, condition, coarse) for channel in channels(bench)))


def _of_channel(channel: Channel, condition: Condition, coarse: NDArray[np.float64]) -> ChannelNoise:
    sensor = OUTPUTS[channel.name]
    step = max(channel.resolution, float(coarse[sensor])) if condition == "12 bits" else channel.resolution
    power = channel.noise**2
    colour = COLOURS.get(condition, 0.0) if sensor in COLOURED else 0.0
    both = power + step**2 / 12.0
    return ChannelNoise((both, colour * power) if colour else (both,))
