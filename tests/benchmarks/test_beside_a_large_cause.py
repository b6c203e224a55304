"""What hides beside a much larger cause, and makes that look unphysical, is found with it."""

import pytest

from astb.diagnose import with_roles
from benchmarks.diagnosis.bench_cases import BenchCases
from benchmarks.diagnosis.ground_truth import GroundTruth
from benchmarks.diagnosis.sealed import measure
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.systems.records import read_records

HIDDEN = {"leak.left": {"area": 1e-7}, "maxwell": {"ratio": 0.2, "time": 0.13}}
CANDIDATES = (
    *(
        "leak.left",
        "leak_laminar.left",
        "bellows_volume",
        "creep",
        "pressure_offset.left",
        "auxiliary_volume",
    ),
    *("area_slope", "force_offset.left", "discharge", "emergency_compliance", "pressure_gain", "heat"),
    *("cell_offset.1", "cell_offset.3", "asymmetric_orifice", "maxwell"),
)


@pytest.mark.slow
def test_rubber_beside_a_large_leak_is_found_with_it(tmp_path):
    measure(GroundTruth(seed=0, kind="pair", condition="white", effects=HIDDEN), tmp_path / "run")
    simulator = BenchCases().simulator
    dataset = with_roles(read_records([tmp_path / "run"], simulator))
    finding = diagnose(dataset, simulator, Config(effects=CANDIDATES, with_panel=False))
    assert set(finding.names) == set(HIDDEN)
