"""The extended model of a finding as a file: fitted parameters, causes, and terms that are no effect of the
catalogue.
"""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from bench_protocol.words import SIDES
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.layout import Sensor
from bench_sim.parameters import Parameters, load
from bench_sim.parameters.model_file import Model, Notes, write_model
from diagnosis.estimates import Z95, decimals
from diagnosis.finding import Finding
from diagnosis.systems.air_spring.parameters import DRAG
from diagnosis.systems.air_spring.surfaces import TERMS

#: Significant digits of every number: rounding moves an output by less than a fiftieth of its sensor's noise.
DIGITS: Final = 6
_OFFSET: Final = ".offset"


def write_extended(path: Path, finding: Finding, based_on: str) -> None:
    """Write the extended model of ``finding`` to ``path``; ``based_on`` is the tested model: a set or a file.

    Numbers are rounded to `DIGITS`; their intervals are comments above them. Raises OSError if the file cannot be
    written.
    """
    parameters = load(based_on)
    base = based_on if Path(based_on).suffix != ".toml" else os.path.relpath(based_on, path.parent)
    changes = changes_of(finding.models.after, parameters) | _surfaces(finding, parameters)
    write_model(
        path,
        Model(base, changes, _effects(finding), _provenance(finding)),
        _notes(finding, parameters),
        DIGITS,
    )


def changes_of(values: Mapping[str, float], parameters: Parameters) -> dict[str, Any]:
    """Return fitted values in the form of a parameter set: one value for each side, and the offsets by sensor.

    The fitted drags of sensors are left out.
    """
    changes: dict[str, Any] = {}
    for name, value in values.items():
        side, _, quantity = name.partition(".")
        if name.endswith(DRAG):
            continue  # transducers and ticks of the rig make it; a rig with the model has it already
        if name.endswith(_OFFSET):
            sensor = _sensor(name)
            before = float(parameters.entries["sensor_bias"].value[Sensor[sensor.upper()]])
            changes.setdefault("sensor_bias", {})[sensor] = before + value
        elif side in SIDES:
            both = changes.setdefault(quantity, parameters.entries[quantity].value.tolist())
            both[SIDES.index(side)] = value
        else:
            changes[name] = [value] * len(SIDES)
    return changes


def _sensor(name: str) -> str:
    return name.removesuffix(_OFFSET).replace(".", "_")


def _surfaces(finding: Finding, parameters: Parameters) -> dict[str, Any]:
    """Return the parameters for terms that are no effect of the catalogue, added to those of the set, with their
    ranges.
    """
    changes: dict[str, Any] = {}
    for name, coefficients in finding.models.effects.items():
        if name in TERMS:
            changes |= TERMS[name].over(parameters.record).changes(parameters.record, coefficients)
    return changes


def _effects(finding: Finding) -> dict[str, dict[str, float]]:
    return {
        name: dict(values)
        for name, values in finding.models.effects.items()
        if name.partition(".")[0] in CATALOGUE
    }


def _notes(finding: Finding, parameters: Parameters) -> Notes:
    """Return the comments of the file: 95 % intervals of the parameters, and ranges of terms that are no effect of the
    catalogue.
    """
    notes: dict[str, dict[str, str]] = {"change": {}, "sensor_bias": {}}
    for name, side, text in _fitted(finding):
        if name.endswith(_OFFSET):
            known = parameters.entries["sensor_bias"].value[Sensor[_sensor(name).upper()]]
            notes["sensor_bias"][_sensor(name)] = f"{text} more than the base model has" if known else text
        else:
            before = notes["change"].get(name)
            own = f"{side} {text}".strip()
            notes["change"][name] = f"{before}; {own}" if before else own
    for cause in finding.causes:
        notes[cause.effect] = {
            one.name: interval(one.low, one.high, one.unit)
            for one in cause.parameters
            if one.low is not None and one.high is not None
        }
    for unknown in finding.unknowns:
        notes[unknown.surface] = {"coefficients": unknown.sentence}
    return notes


def _fitted(finding: Finding) -> Iterator[tuple[str, str, str]]:
    """Yield name, side and interval of every parameter of the extended model, in the order of the file."""
    shifts = {shift.name: shift for shift in finding.shifts if not shift.run}
    for name in finding.models.after:
        shift = shifts.get(name)
        if shift is None or shift.after is None or shift.sd_after is None:
            continue
        width = Z95 * shift.sd_after
        text = interval(shift.after - width, shift.after + width, shift.unit)
        side, _, quantity = name.partition(".")
        yield (quantity, side, text) if side in SIDES and not name.endswith(_OFFSET) else (name, "", text)


def interval(low: float, high: float, unit: str) -> str:
    """Return a 95 % interval as text. The number of digits follows from its width."""
    digits = decimals(low, high)
    return f"95 %: {low:.{digits}f} to {high:.{digits}f} {unit}".removesuffix(" 1")


def _provenance(finding: Finding) -> dict[str, Any]:
    return {
        "verdict": str(finding.verdict),
        "sentence": finding.sentence,
        "data": finding.provenance.digest,
        "seed": finding.provenance.seed,
        "versions": finding.provenance.versions,
    }
