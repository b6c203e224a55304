"""The catalogue of plans that judge: a sound bench passes each, and what a plan is meant for makes it fail."""

import pytest

from bench_protocol.units import bar, mm
from bench_records.result import CheckVerdict, Outcome
from test_plans.discovery import plans
from test_plans.instruments import ordinary

slow = pytest.mark.slow


# Of sound rigs that differ in more than their seeds the mutation matrix counts hundreds.
@slow
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    "name",
    [
        "axial_stiffness",
        "differential_pressure_valve",
        "dynamic_stiffness",
        "lateral_stiffness",
        "leveling",
        "measuring_chain",
        "orifice_plates",
        "roll_coupling",
        "tightness",
    ],
)
def test_a_sound_bench_passes(judged, name, seed):
    result, failed = judged(name, seed, instruments=ordinary())
    assert result.verdict is Outcome.PASS, result.reason or failed
    assert result.duration == pytest.approx(plans()[name].lasts, rel=0.1)
    checked = {one.about for one in result.checks}
    spared = {one for one in plans()[name].checks if one.about not in checked}
    assert spared <= {"cells over the known mass"}, "it declares what it does not check"
    last = [one.name for one in result.phases if not one.name.startswith("orifice plates")][-1]
    assert last in {"depressurise", "disarm"}


#: A fault, and all that must fail of it; whatever else there is has to pass.
SIDES = ("left", "right")
MEANT_FOR = {
    "tightness: a leak of one bellows": (
        "tightness",
        {"leak_conductance": [5e-11, 0.0]},
        {f"air lost per minute, left spring at {load}" for load in ("AW0", "AW3")},
    ),
    "axial stiffness: a bellows that is too large": (
        "axial_stiffness",
        {"effects": [("bellows_volume", "15 %")]},
        {f"{side} vertical stiffness, closed" for side in SIDES},
    ),
    "axial stiffness: an auxiliary chamber that is too small": (
        "axial_stiffness",
        {"effects": [("auxiliary_volume", "-25 %")]},
        {f"{side} vertical stiffness, open" for side in SIDES},
    ),
    "axial stiffness: another contour": (
        "axial_stiffness",
        {"effects": [("area_slope", "0.1 m")]},
        {f"{side} vertical stiffness, isobaric" for side in SIDES},
    ),
    "axial stiffness: a chamber that does not shut off": (
        "axial_stiffness",
        {"faults": [("stuck_reservoir_valve", {"side": "left", "at": "open"})]},
        {"left vertical stiffness, closed"},
    ),
    "lateral stiffness: twice the friction": (
        "lateral_stiffness",
        {"friction_lateral": 700.0},
        {"lateral stiffness K'", "lateral damping c"},
    ),
    "lateral stiffness: a soft shell": (
        "lateral_stiffness",
        {"shell_stiffness_lateral": 25e3},
        {"lateral stiffness K'"},
    ),
    "track record: auxiliary chambers of half the volume": (
        "track_record",
        {"effects": [("auxiliary_volume", "-50 %")]},
        {"vertical stiffness K', 0.5 to 2 Hz", "vertical loss angle, 0.5 to 2 Hz"},
    ),
    "differential pressure valve: stuck open": (
        "differential_pressure_valve",
        {"faults": [("stuck_dpv", {"at": "open"})]},
        {f"{what}, {side} higher" for what in ("opens", "closes again") for side in SIDES},
    ),
    "differential pressure valve: stuck shut": (
        "differential_pressure_valve",
        {"faults": [("stuck_dpv", {"at": "shut"})]},
        {f"{what}, {side} higher" for what in ("opens", "closes again") for side in SIDES},
    ),
    "differential pressure valve: a seat that leaks": (
        "differential_pressure_valve",
        {"effects": [("dpv_leak", "0.1 mm2")]},
        {f"air lost per minute, {side} spring, {side} higher" for side in SIDES},
    ),
    "differential pressure valve: closes too late": (
        "differential_pressure_valve",
        {"dpv_reclosing": 0.7 * bar},
        {f"closes again, {side} higher" for side in SIDES},
    ),
    "orifice plates: the left one is half clogged": (
        "orifice_plates",
        {"faults": [("blocked_orifice", {"side": "left", "share": "40 %"})]},
        {f"left {what} with {plate} mm" for what in ("K'", "c") for plate in (10, 13, 16, 18)},
    ),
    "orifice plates: edges that are worn round": (
        "orifice_plates",
        {"discharge_coefficient": 0.75},
        {f"{side} K' with {plate} mm" for side in SIDES for plate in (10, 13)}
        | {f"{side} c with {plate} mm" for side in SIDES for plate in (13, 16, 18)},
    ),
    "roll and coupling: nothing sideways": (
        "roll_coupling",
        {"coupling_sign": 0.0},
        {"lateral force by roll"},
    ),
    "roll and coupling: a stiff shell": (
        "roll_coupling",
        {"shell_stiffness_vertical": 120e3},
        {"roll stiffness"},
    ),
    "leveling: a dead band that is too wide": (
        "leveling",
        {"effects": [("leveling_deadband", "2 mm")]},
        {
            f"{side} valve{what}"
            for side in SIDES
            for what in (" opens to fill", " opens to exhaust", ", dead band", ", delay")
        },
    ),
    "leveling: a dash-pot that is too slow": (
        "leveling",
        {"effects": [("leveling_delay", "1 s")]},
        {f"{side} valve, delay" for side in SIDES},
    ),
    "leveling: a valve that is stuck shut": (
        "leveling",
        {"faults": [("stuck_leveling", {"side": "left", "at": "shut"})]},
        {
            *(f"left valve opens to {verb}" for verb in ("fill", "exhaust")),
            *(f"left valve, time to {way}" for way in ("fill to AW3", "exhaust to AW0")),
            *(f"left valve, {what}" for what in ("delay", "dead band")),
        },
    ),
    "leveling: a rod that is set wrongly": (
        "leveling",
        {"lever_offset": [3 * mm, 0.0]},
        {f"left valve opens to {verb}" for verb in ("fill", "exhaust")} | {"left valve, delay"},
    ),
}
#: One of each plan is tried every time; the others take as long again.


@slow
@pytest.mark.parametrize("case", MEANT_FOR)
def test_a_plan_detects_only_the_effects_that_it_covers(judged, case):
    name, broken, expected = MEANT_FOR[case]
    result, failed = judged(name, **broken)
    assert result.verdict is Outcome.FAIL, result.reason
    near = {one.name for one in result.checks if one.verdict is CheckVerdict.MARGINAL}
    assert failed <= expected <= failed | near  # what lies on its limit may lie to either side


@pytest.mark.parametrize(
    ("name", "given"),
    [
        pytest.param("axial_stiffness", {"load": "AW3"}, marks=slow),
        pytest.param("dynamic_stiffness", {"load": "AW3"}, marks=slow),
        pytest.param("orifice_plates", {"load": "AW3"}, marks=slow),
        pytest.param("roll_coupling", {"load": "AW3", "roll": "50 mrad"}, marks=slow),
        pytest.param("lateral_stiffness", {"load": "AW3", "amplitude": "20mm"}, marks=slow),
        ("lateral_stiffness", {"load": "AW3", "amplitude": "7 mm", "offset": "-30 mm"}),
        pytest.param("lateral_stiffness", {"amplitude": "2mm", "offset": "40mm"}, marks=slow),
    ],
)
def test_a_sound_bench_passes_with_other_parameters(judged, name, given):
    result, failed = judged(name, given=given)
    assert result.verdict is Outcome.PASS, result.reason or failed


@slow
@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"orifice_diameter": 16 * mm}, {"c at 1 Hz", "loss angle at 1 Hz", "c at 2 mm", "c at 10 mm"}),
        ({"shell_stiffness_vertical": 120e3}, {"K' at 0.5 Hz", "K' at 1 Hz", "K' at 2 mm", "K' at 10 mm"}),
    ],
)
def test_the_dynamic_stiffness_tells_a_wide_orifice_from_a_stiff_shell(judged, changes, expected):
    """Both move many values; damping is the orifice's, stiffness alone the shell's."""
    result, failed = judged("dynamic_stiffness", **changes)
    assert result.verdict is Outcome.FAIL
    assert failed >= expected
    damping = {name for name in failed if name.startswith("c at")}
    assert bool(damping) == ("orifice_diameter" in changes)


def test_parameters_that_together_meet_the_bump_stop_are_refused_before_anything_moves(judged):
    result, _ = judged("lateral_stiffness", given={"amplitude": "15mm", "offset": "20mm"})
    assert result.verdict is Outcome.BLOCKED
    assert result.reason.startswith(
        "the parameters: amplitude = 15 mm about offset = 20 mm takes the bolster 33 mm"
    )
    assert result.duration < 3.0  # with a look at the supply, for which the bench is armed


@slow
def test_a_longer_hold_is_held_longer(judged):
    result, _ = judged("tightness", given={"hold": "1 min"})
    assert result.duration > plans()["tightness"].lasts + 50
    assert result.parameters == {"hold": "60 s"}


def test_a_valve_is_waited_for_longer_than_it_may_take(judged):
    result, _ = judged("leveling", given={"within": "30 s"})
    assert result.verdict is Outcome.BLOCKED
    assert "within = 30 s must be longer than the 38 s that a valve may take" in result.reason
