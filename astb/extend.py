"""What a diagnosis found, written back: the fitted parameters and the causes as a model file that the rig can load."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench_protocol.table import SIDES
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.layout import Sensor
from bench_sim.parameters import Parameters, load
from bench_sim.parameters.model_file import Model, write_model
from diagnosis.finding import Finding

_OFFSET = ".offset"


def write_extended(path: Path, finding: Finding, based_on: str) -> None:
    """Write the extended model of ``finding`` to ``path``; ``based_on`` is the model in doubt, a set or a file.

    Raises OSError.
    """
    parameters = load(based_on)
    base = based_on if Path(based_on).suffix != ".toml" else os.path.relpath(based_on, path.parent)
    write_model(
        path, Model(base, _changes(finding.models.after, parameters), _effects(finding), _told(finding))
    )


def _changes(values: Mapping[str, float], parameters: Parameters) -> dict[str, Any]:
    """Parameters in the shape that the set has them: by side, for both sides alike, and offsets by sensor."""
    changes: dict[str, Any] = {}
    for name, value in values.items():
        side, _, quantity = name.partition(".")
        if name.endswith(_OFFSET):
            sensor = name.removesuffix(_OFFSET).replace(".", "_")
            before = float(parameters.entries["sensor_bias"].value[Sensor[sensor.upper()]])
            changes.setdefault("sensor_bias", {})[sensor] = before + value
        elif side in SIDES:
            both = changes.setdefault(quantity, parameters.entries[quantity].value.tolist())
            both[SIDES.index(side)] = value
        else:
            changes[name] = [value] * len(SIDES)
    return changes


def _effects(finding: Finding) -> dict[str, dict[str, float]]:
    return {
        name: dict(values)
        for name, values in finding.models.effects.items()
        if name.partition(".")[0] in CATALOGUE
    }


def _told(finding: Finding) -> dict[str, Any]:
    return {
        "verdict": str(finding.verdict),
        "sentence": finding.sentence,
        "data": finding.provenance.digest,
        "seed": finding.provenance.seed,
        "versions": finding.provenance.versions,
    }
