"""A late channel of a bench is named with its delay, and no other channel remains late."""

import pytest

from astb.diagnose import with_roles
from astb_studies.benchmarks.diagnosis.bench_cases import BenchCases
from astb_studies.benchmarks.diagnosis.ground_truth import GroundTruth
from astb_studies.benchmarks.diagnosis.sealed import measure
from bench_sim.model.effects import CATALOGUE
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.finding import Verdict
from diagnosis.systems.records import read_records

#: Effects that delay readings, and the effects that look like them.
LATE = (
    *("force_lag", "force_latency", "pressure_lag", "pressure_latency", "displacement_latency", "clock_skew"),
    *("maxwell", "platen_inertia"),
)


@pytest.mark.slow
@pytest.mark.parametrize(("cause", "ms"), [("force_lag", 5.713), ("displacement_latency", 5.0)])
def test_a_late_channel_of_a_bench_is_named(tmp_path, cause, ms):
    values = {CATALOGUE[cause].amplitude.name: 1e-3 * ms}
    measure(GroundTruth(seed=5, kind="single", condition="white", effects={cause: values}), tmp_path / "run")
    simulator = BenchCases().simulator
    dataset = with_roles(read_records([tmp_path / "run"], simulator))
    finding = diagnose(dataset, simulator, Config(effects=LATE, with_panel=False))
    assert finding.verdict is Verdict.NAMED
    assert finding.names == (cause,)
    told = finding.causes[0].parameters[0]
    assert told.low < ms < told.high
    assert told.high - told.low < 0.1
    assert not [text for text in finding.remains if "scores in the final model" in text]
