"""A transducer whose zero is half a bar off: the plan says so and does what it can, and the diagnosis names it."""

import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.units import Hz, bar, mm
from bench_records.result import Outcome
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from bench_sim.parameters.effects import with_effects
from bench_sim.rig.rig import Rig
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.finding import Verdict
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.records import read_records
from test_plans.execution import execute
from test_plans.loads import AW0, AW3
from test_plans.programmes.motions import Part, Programme, Stretch, Wave
from test_plans.programmes.perform import programme_plan

pytestmark = pytest.mark.slow

UP_AND_DOWN = (Stretch((Wave("vertical", 5 * mm, 0.5 * Hz, 3),)),)
CANDIDATES = ("pressure_gain", "leak.left", *(f"pressure_{what}.left" for what in ("offset", "drift")))


def test_half_a_bar_too_much_is_found_in_a_run_of_two_load_cases(tmp_path):
    """The rig prevents access under the bolster for the second one; the result of the first shows why."""
    sound, offset = load("astb"), 0.5 * bar
    rig = Rig(with_effects(sound, {"pressure_offset.left": {"offset": offset}}), seed=3)
    programme = Programme(
        "short", "Short motions", (Part(AW0, UP_AND_DOWN), Part(AW3, UP_AND_DOWN)), "A test."
    )
    with RigInMemory(rig).bench(seed=3) as bench:
        result = execute(programme_plan(programme), bench, tmp_path, seed=3)
    assert result.verdict is Outcome.INCOMPLETE, result.reason
    text = "left.bellows_pressure reads 0.5"
    assert any(one.startswith(text) for one in result.warnings)
    (missing,) = (one for one in result.checks if one.verdict.value == "not available")
    assert missing.name.startswith("short 2 AW3")
    assert "is not taken up" in missing.note
    assert text in missing.note

    simulator = AirSpring(sound, effects=CATALOGUE)
    config = Config(seed=3, workers=1, effects=CANDIDATES, with_panel=False)
    finding = diagnose(read_records([tmp_path], simulator), simulator, config)
    assert finding.verdict is Verdict.NAMED
    assert list(finding.names) == ["pressure_offset.left"]
    (one,) = finding.causes[0].parameters
    assert one.low < offset / CATALOGUE["pressure_offset"].amplitude.scale < one.high
