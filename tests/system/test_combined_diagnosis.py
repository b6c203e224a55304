"""Diagnosis of records in which wind, track and roll act at once."""

import msgspec
import pytest

from astb.exit_codes import FAIL, INCOMPLETE, PASS

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture
def found(astb_here, tmp_path):
    """Run the plan of a load on a virtual rig with effects, and return the finding."""

    def run(load: str, seed: int, *options: str) -> dict:
        plan = f"crosswind_and_track_{load}"
        code, _, err = astb_here(
            tmp_path, "run", plan, "--virtual", "--seed", f"{seed}", "--out", "run", *options
        )
        assert code in {PASS, FAIL, INCOMPLETE}, err
        code, _, err = astb_here(tmp_path, "diagnose", f"run/{plan}", "--out", "finding")
        assert code == PASS, err
        return msgspec.json.decode((tmp_path / "finding/finding.json").read_bytes())

    return run


@pytest.mark.parametrize(
    ("load", "seed", "options"),
    [
        ("aw0", 5, ()),
        ("aw0", 7, ("--set", "roll=-5mrad", "--set", "wind=4m/s")),
        ("aw3", 1, ()),
        ("aw3", 2, ()),
        ("aw3", 5, ()),
    ],
)
def test_a_sound_bench_has_no_effect(found, load, seed, options):
    finding = found(load, seed, *options)
    assert finding["verdict"] == "no effect"
    assert finding["causes"] == []


@pytest.mark.parametrize(
    ("load", "effect", "change"),
    [
        ("aw0", "auxiliary_volume", -20.0),
        ("aw0", "blocked_orifice.left", 15.0),
        ("aw3", "blocked_orifice.left", 15.0),
    ],
)
def test_a_hidden_effect_is_found_with_its_size(found, load, effect, change):
    finding = found(load, 11, "--effect", f"{effect}={change:g}%")
    (cause,) = finding["causes"]
    (size,) = cause["parameters"]
    assert cause["effect"] == effect
    assert size["low"] < change < size["high"]
    assert size["high"] - size["low"] < abs(change), "the interval is narrower than the effect"
