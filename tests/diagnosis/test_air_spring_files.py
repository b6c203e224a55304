"""A foreign rig's files of two air springs: what the model itself would have measured comes back through the map."""

from pathlib import Path

import numpy as np
import pytest

from bench_sim.parameters import load
from diagnosis.contracts import DiagnosisError, Experiment
from diagnosis.systems.air_spring import AirSpring
from diagnosis.systems.mapping import read_mapped

STEP = 5e-3

MAP = """
system = "air_spring"
parameters = "{parameters}"
[time]
column = "t"
[columns]
"left.height" = {{ column = "zl", unit = "mm" }}
"right.height" = {{ column = "zr", unit = "mm" }}
"left.bellows_pressure" = {{ column = "pl", unit = "bar", reading = "absolute" }}
"right.bellows_pressure" = {{ column = "pr", unit = "bar", reading = "absolute" }}
"vertical_left.force" = {{ column = "F", unit = "kN", noise = "20 N" }}
[settings]
nominal_preload = "53.5 kN"
ambient_pressure = "1.01325 bar"
"""


def write(folder: Path, parameters: str = "astb") -> tuple[Path, Path]:
    """Write what noiseless sensors on the model read while both springs go up and down by 4 mm at 0.8 Hz."""
    clock = STEP * np.arange(2400)
    height = 4e-3 * np.sin(2.0 * np.pi * 0.8 * clock) * np.clip(clock, 0.0, 1.0)
    names = ("left.bellows_pressure", "right.bellows_pressure", "vertical_left.force")
    model = AirSpring(load("astb"), effects={}, only=names)
    experiment = Experiment(
        "made",
        clock,
        {"left.height": height, "right.height": height},
        {"left.bellows_pressure": 3.5e5, "right.bellows_pressure": 3.5e5, "nominal_preload": 53.5e3},
    )
    columns = dict(zip((c.name for c in model.channels), model.run(experiment, {}, {}).T, strict=True))
    left, right = (1e-5 * columns[name] + 1.01325 for name in names[:2])
    table = np.column_stack((clock, 1e3 * height, 1e3 * height, left, right, 1e-3 * columns[names[2]]))
    data, mapping = folder / "made.csv", folder / "map.toml"
    np.savetxt(data, table, fmt="%.9f", delimiter=",", header="t,zl,zr,pl,pr,F", comments="")
    mapping.write_text(MAP.format(parameters=parameters), encoding="utf-8")
    return data, mapping


def test_the_model_recognises_its_own_measurements(tmp_path: Path) -> None:
    data, mapping = write(tmp_path)
    simulator, dataset = read_mapped([data], mapping)
    (run,) = dataset.runs
    names = [channel.name for channel in dataset.channels]
    assert names == ["left.bellows_pressure", "right.bellows_pressure", "vertical_left.force"]
    assert dataset.channels[0].noise > 0.0  # the parameter set knows the sensor
    assert dataset.channels[2].noise == 20.0  # the map knows better
    assert run.experiment.settings["left.bellows_pressure"] == pytest.approx(3.5e5, rel=1e-3)
    left = (run.outputs - simulator.run(run.experiment, {}, {}))[400:]
    swing = np.ptp(run.outputs[400:], axis=0)
    assert np.all(np.std(left, axis=0) < 0.01 * swing)


def test_a_parameter_set_that_is_none_is_told_with_the_map(tmp_path: Path) -> None:
    data, mapping = write(tmp_path, "nowhere.toml")
    with pytest.raises(DiagnosisError, match=r"map\.toml: parameters: .*nowhere\.toml"):
        read_mapped([data], mapping)
