"""How load cells share their load is named: a seat, a load or a support that a rig hides, from one record."""

import pytest

from bench_protocol.units import Hz, mm, mrad
from bench_sim.model.effects import CATALOGUE
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.finding import Verdict
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.records import read_records
from test_plans.programmes.motions import Stretch, Wave

pytestmark = pytest.mark.slow

#: Loads that differ from corner to corner, which a motion straight up and down does not make.
MOTION = (
    Stretch(
        (
            Wave("vertical", 5 * mm, 0.5 * Hz, 3),
            Wave("lateral", 6 * mm, 0.5 * Hz, 3),
            Wave("roll", 4 * mrad, 0.7 * Hz, 3),
        )
    ),
)
#: Candidates: the hidden effect, its neighbours, and all other effects on load cells.
CANDIDATES = (
    *(f"seat_offset.{side}" for side in ("left", "right")),
    "load_offset",
    *(f"soft_support.{cell}" for cell in (1, 2, 3, 4)),
    "twisted_seat",
    "crosstalk",
    "force_gain",
    "coupling",
    *(f"force_offset.{side}" for side in ("left", "right")),
)
#: SI. For offsets below this, one load case cannot separate a moment from the zeros of the cells.
HIDDEN = {
    "seat_offset.left": {"ahead": 10e-3},
    "seat_offset.right": {"ahead": -10e-3},
    "load_offset": {"ahead": 10e-3},
    "soft_support.1": {"softer": 0.1},
    "soft_support.2": {"softer": 0.1},
    "soft_support.3": {"softer": 0.1},
    "soft_support.4": {"softer": 0.1},
    "twisted_seat": {"force": 500.0},
}


def found_in(bench_record, hidden, seed=1, effects=CANDIDATES):
    """What a diagnosis says of a rig that hides some effects, and of what: a ``hidden`` name, or nothing."""
    values = {hidden: HIDDEN[hidden]} if hidden else {}
    record = bench_record(hidden or "sound", MOTION, effects=values, seed=seed)
    simulator = AirSpring(record.parameters, effects=CATALOGUE)
    config = Config(seed=seed, workers=1, effects=effects, with_panel=False)
    return diagnose(read_records([record.directory], simulator), simulator, config), simulator


def assert_named(finding, simulator, name):
    """It is the only named cause, and its interval contains the true value."""
    assert finding.verdict is Verdict.NAMED, finding.verdict
    assert list(finding.names) == [name]
    (one,) = finding.causes[0].parameters
    (truth,) = HIDDEN[name].values()
    assert one.low < truth / simulator.catalogue[name].amplitude.scale < one.high


@pytest.mark.parametrize("name", ["seat_offset.left", "soft_support.3"])
def test_what_a_rig_hides_below_its_cells_is_named_with_its_size(bench_record, name):
    assert_named(*found_in(bench_record, name), name)


def test_a_sound_rig_is_not_accused(bench_record):
    finding, _ = found_in(bench_record, None, seed=2)
    assert finding.verdict is Verdict.NO_EFFECT
