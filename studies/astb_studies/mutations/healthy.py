"""Fault-free rigs, each drawn from the tolerances of its parts, sensors and ambient conditions."""

import csv
import tomllib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np
from msgspec import Meta

from astb.rig_file import Simulation
from bench_protocol.written_values import write_value
from bench_sim.model.quantities import QUANTITIES
from bench_sim.parameters import load
from bench_sim.parameters.model_file import read_changes
from bench_sim.parameters.sensors import SENSOR_KINDS

TABLE: Final = Path(__file__).with_name("tolerances.toml")
FOUND: Final = Path(__file__).with_name("healthy.csv")
UNITS: Final = {quantity.name: quantity.unit for quantity in QUANTITIES}
#: A part beyond its tolerance is not delivered: that many standard deviations.
CUT: Final = 2.0
#: How the reason of a plan begins that did not begin: a precondition was not met, or its parameters were refused.
NOT_BEGUN: Final = ("not ready: ", "the parameters: ")


class Tolerance(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Tolerance of a value of a fault-free rig: a fraction of the nominal value, or a lowest and a highest value."""

    law: Literal["normal", "even"]
    source: str
    spread: Annotated[float, Meta(gt=0, lt=1)] | None = None
    range: tuple[str, str] | None = None


class Tolerances(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Tolerances of parts and ambient conditions by parameter, of gains by kind of sensor."""

    part: dict[str, Tolerance]
    day: dict[str, Tolerance]
    gain: dict[str, Tolerance]


@cache
def tolerances() -> Tolerances:
    """Return the table. Raises msgspec.ValidationError, with its place, for an invalid row."""
    return msgspec.convert(tomllib.loads(TABLE.read_text(encoding="utf-8")), Tolerances)


def sound_rig(seed: int) -> Simulation:
    """Return the sound rig that ``seed`` draws, its sensors' zeros included."""
    chance, drawing, table = np.random.default_rng([seed, 1]), load(), tolerances()
    change: dict[str, Any] = {}
    for name, one in (table.part | table.day).items():
        entry = drawing.entries[name]
        low, high = _ends(name, one, entry.value)
        values = low + (high - low) * _draw(chance, one.law, entry.value.shape)
        unit = UNITS[name]
        change[name] = [write_value(value, unit, unit) for value in np.atleast_1d(values)]
        if not entry.value.shape:
            change[name] = change[name][0]
    gains = {
        sensor.name.lower(): write_value(one.spread * (2 * float(_draw(chance, one.law, ())) - 1), "1", "1")
        for kind, one in table.gain.items()
        for sensor in SENSOR_KINDS[kind][1]
        if one.spread
    }
    return Simulation(seed=seed, change=change | {"sensor_gain": gains})


def _ends(name: str, one: Tolerance, drawn: Any) -> tuple[Any, Any]:
    """Return lowest and highest value (SI)."""
    if one.range is None:
        assert one.spread is not None
        off = one.spread * np.abs(drawn)
        return drawn - off, drawn + off
    low, high = (read_changes({name: text})[name] for text in one.range)
    return low, high


def _draw(chance: np.random.Generator, law: str, shape: tuple[int, ...]) -> Any:
    """Return the position of a value between both ends (0 to 1)."""
    if law == "even":
        return chance.uniform(size=shape)
    drawn = chance.normal(size=shape)
    while (beyond := np.abs(drawn) > CUT).any():
        drawn = np.where(beyond, chance.normal(size=shape), drawn)
    return 0.5 + 0.5 * drawn / CUT


class SoundRun(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one plan on one sound rig."""

    plan: str
    seed: int
    verdict: str
    told: str  #: failed checks, or why the run was blocked
    version: str = ""  #: of the code: commit and day
    values: str = ""  #: of the plan's parameters, where they are not the defaults

    @property
    def refused(self) -> bool:
        """Whether the plan did not begin."""
        return self.told.startswith(NOT_BEGUN)

    @property
    def rejected(self) -> bool:
        """Whether a check failed, or the plan did not finish; a check *not available* is not a rejection."""
        return self.verdict not in ("pass", "incomplete") and not self.refused


def write_sound_runs(runs: Iterable[SoundRun], path: Path = FOUND) -> None:
    """Write the results in the order of the seeds."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(SoundRun.__struct_fields__)
        writer.writerows(msgspec.structs.astuple(run) for run in sorted(runs, key=lambda run: run.seed))


def read_sound_runs(path: Path = FOUND) -> list[SoundRun]:
    """Return the stored results."""
    with path.open(encoding="utf-8", newline="") as file:
        return [msgspec.convert(row, SoundRun, strict=False) for row in csv.DictReader(file)]
