"""The specimen: its file states the limits, another file states others, and errors in it are reported."""

import re
from dataclasses import replace
from types import SimpleNamespace

import pytest

from astb_studies.paper.plans.lateral_pressure import PARTS
from bench_protocol.named_files import named_files
from bench_protocol.units import bar, kN, mm
from bench_protocol.words import PROVENANCES
from bench_records.junit import junit
from bench_records.report import write_report
from bench_records.result import Outcome, read_result
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.loads import Band, Limits, SpecimenError
from test_plans.plan import plan
from test_plans.plans.leak_down import leak_down
from test_plans.run import Run
from test_plans.specimen import ordinary, packaged, read_specimen
from test_plans.steps.carrying import part_of

TEXT = named_files("specimens")["astb"].read_text(encoding="utf-8")


def changed(path, *changes):
    """The ordinary specimen's file with some of its text changed; every change must find what it replaces."""
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", packaged())
def test_every_specimen_that_comes_with_the_bench_can_be_read_and_says_where_its_values_come_from(name):
    one = read_specimen(name)
    assert one.loads
    text = named_files("specimens")[name].read_text(encoding="utf-8")
    entries = [line for line in text.splitlines() if "unit = " in line]
    assert entries
    for line in entries:
        assert re.search(r'provenance = "([^"]+)"', line)[1] in PROVENANCES
        assert len(re.search(r'source = "([^"]*)"', line)[1]) > 5, line


def test_the_ordinary_specimen_is_that_of_the_drawing():
    """By hand from the text of the file: 53.5 kN, 8 % about 464 kN/m at 1 Hz, 6 mm to either side of design height."""
    one, load = ordinary(), ordinary().load("AW0")
    assert (one.bellows_volume, one.effective_area) == (0.030, 0.260)
    assert load.preload == 53.5 * kN
    assert load.limits.band("pressure") == Band(1.98 * bar, 2.11 * bar)
    assert load.limits.band("carried") == Band(52.6 * kN, 54.4 * kN)
    storage = {frequency: band for frequency, band, _ in load.sweep("vertical")}
    assert (storage[1.0].low, storage[1.0].high) == pytest.approx((426.88 * kN, 501.12 * kN))
    assert one.limits.band("rest_height") == Band(-6 * mm, 6 * mm)
    # The spring must be able to carry what its pressure says.
    for case in one.loads.values():
        assert case.fill_pressure * one.effective_area == pytest.approx(case.preload, rel=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            'value = 53.5, unit = "kN"',
            'value = 53.5, unit = "bar"',
            "load_case.AW0.preload = 53.5 bar has the wrong unit; use N or kN",
        ),
        (
            'value = 53.5, unit = "kN"',
            'value = "much", unit = "kN"',
            "load_case.AW0.preload.value = 'much' is not a number",
        ),
        (
            'value = 53.5, unit = "kN"',
            'unit = "kN"',
            "load_case.AW0.preload has no value; use value, with unit, provenance, source",
        ),
        (
            "low = -6.0, high = 6.0",
            "low = -6.0, expected = 6.0",
            "limits.rest_height: low and expected are not a complete value; use (low, high) or low or high or",
        ),
        (
            "low = -6.0, high = 6.0",
            "low = 7.0, high = 6.0",
            "limits.rest_height.low = 7 mm is above high = 6 mm",
        ),
        (
            "expected = 387.0, tolerance = 0.08",
            "expected = 387.0, tolerance = 8",
            "vertical_secant.tolerance = 8 is not a fr",
        ),
        (
            "frequency = [0.5, 1.0, 2.0, 3.0]",
            "frequency = [0.5]",
            "are not lists of the same length",
        ),
        (
            "rest_height =",
            "rest_hight =",
            "limits.rest_hight is not a key of a specimen; did you mean 'rest_height'?",
        ),
        (
            "bellows_volume =",
            "bellows_volumes =",
            "properties.bellows_volumes is not a key of a specimen; did you mean 'bellows_volume'",
        ),
        ('serial_number = "virtual"', "", "the key serial_number is missing"),
        ('serial_number = "virtual"', 'serial_number = ""', "serial_number = '' is not a text"),
        (
            'provenance = "data sheet"',
            'provenance = "hearsay"',
            "provenance = 'hearsay'; use one of measured, data",
        ),
        ('source = "at design height"', 'source = " "', "properties.bellows_volume.source is empty"),
        ('type = "', "type = ", "is not TOML"),
    ],
)
def test_what_does_not_fit_is_refused_with_file_key_and_value(tmp_path, old, new, told):
    path = changed(tmp_path / "wrong.toml", (old, new))
    with pytest.raises(SpecimenError, match=re.escape(told)) as error:
        read_specimen(path)
    assert "wrong.toml" in str(error.value)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            [("value = 53.5,", "value = 45.0,"), ("value = 2.058,", "value = 1.731,")],
            "load_case.AW0.preload = 45 kN lies outside of limits.carried (at least 52.6 kN, at most 54.4 kN)",
        ),
        (
            [("value = 0.26,", "value = 0.22,")],
            "fill_pressure = 5.577 bar on effective_area = 0.22 m2 bears 122.7 kN; 6.591 bar would bear it",
        ),
        (
            [("low = 5.40, high = 5.70", "low = 4.40, high = 4.70")],
            "load_case.AW3.fill_pressure = 5.577 bar is far outside of limits.pressure (at least 4.4 bar, at most",
        ),
        (
            [("value = 8.0, unit", "value = 150.0, unit")],
            "load_case.AW3.roll_load = 150 kN would lift a spring",
        ),
        (
            [("value = 53.5,", "value = 0.0,")],
            "load_case.AW0.preload = 0 kN is not plausible; use 1 to 1e+07 N",
        ),
        (
            [("[load_case.AW0]", "[load_case.AW9]"), ("[load_case.AW3]", "[load_case.AW0]")]
            + [("load_case.AW0.", "load_case.AW9.")] * 5
            + [("load_case.AW3.", "load_case.AW0.")] * 5
            + [("[load_case.AW9]", "[load_case.AW3]")]
            + [("load_case.AW9.", "load_case.AW3.")] * 5,
            "the empty car (AW0, 145 kN) must be lighter than the full one (AW3, 53.5 kN)",
        ),
    ],
)
def test_a_file_that_contradicts_itself_is_refused_with_both_values(tmp_path, changes, told):
    with pytest.raises(SpecimenError, match=re.escape(told)) as error:
        read_specimen(changed(tmp_path / "wrong.toml", *changes))
    assert "wrong.toml" in str(error.value)


def test_title_and_instruction_say_what_this_specimen_has_to_carry(tmp_path):
    """A lighter car: nothing that is said of the run may come from the ordinary specimen."""
    light = read_specimen(
        changed(
            tmp_path / "light.toml",
            ("value = 53.5,", "value = 45.0,"),
            ("value = 2.058,", "value = 1.731,"),
            ("low = 52.6, high = 54.4", "low = 44.4, high = 45.6"),
            ("low = 1.98, high = 2.11", "low = 1.66, high = 1.78"),
        )
    )
    assert plans()["aw0"].on(light).title == "AW0: the empty car, 45 kN on each spring."
    ordinary_loads = {f"{load.preload / kN:g} kN" for load in ordinary().loads.values()}
    for one in plans().values():
        told = one.on(replace(light, loads={})).instruction
        assert not [load for load in ordinary_loads if load in told], f"{one.name} knows the load by itself"
        assert "{" not in told


def test_preloads_around_a_load_case_are_parts_of_it(tmp_path):
    """By hand for the ordinary specimen; another one's are as far from its own."""
    run = SimpleNamespace(specimen=ordinary())
    assert [part_of(run, "AW0", part).preload / kN for part in PARTS["AW0"]] == [43.0, 48.0, 53.5, 59.0, 64.0]
    assert [part_of(run, "AW3", part).preload / kN for part in PARTS["AW3"]] == [
        130.0,
        137.5,
        145.0,
        152.5,
        160.0,
    ]


def test_a_missing_file_is_reported_with_the_existing_ones(tmp_path):
    with pytest.raises(
        SpecimenError,
        match=r"nowhere\.toml cannot be read: No such file or directory; check the path, or",
    ):
        read_specimen(tmp_path / "nowhere.toml")


def test_a_missing_key_is_reported_on_access():
    with pytest.raises(SpecimenError, match=r"has no load case AW2; it has AW0, AW3"):
        ordinary().load("AW2")
    with pytest.raises(SpecimenError, match=r"x: limits has no limit of rest_height; add low, high or"):
        Limits("x: limits", {}, {}).band("rest_height")
    with_truth = ordinary().load_of("AW0", 60 * kN)
    assert with_truth.fill_pressure == pytest.approx(60 * kN / 0.26)
    with pytest.raises(SpecimenError, match=r"AW0\.limits at 60 kN has no limit of pressure"):
        with_truth.limits.band("pressure")


def test_limits_of_a_curve_are_interpolated_and_unknown_beyond_it():
    limits = Limits("x: limits", {}, {"k": {0.002: Band(10.0, 20.0), 0.004: Band(20.0, 40.0)}})
    assert limits.curve_at("k", 0.003) == pytest.approx((15.0, 30.0))
    assert limits.curve_at("k", 0.004) == (20.0, 40.0)
    with pytest.raises(
        SpecimenError,
        match=r"has no limit of k at 0.005 \(in Hz, m or rad\); extend its range, which is now 0.002 to",
    ):
        limits.curve_at("k", 0.005)


def test_another_specimen_carries_another_load_and_is_named_wherever_the_result_stands(
    tmp_path, bench_composed
):
    """A heavier car on the same springs: what the plan moves and what it judges come from the file alone."""
    path = changed(
        tmp_path / "heavy.toml",
        ('serial_number = "virtual"', 'serial_number = "0815 <&>"'),
        ('value = 145.0, unit = "kN"', 'value = 130.0, unit = "kN"'),
        ('value = 5.577, unit = "bar"', 'value = 5.0, unit = "bar"'),
        ("low = 144.1, high = 145.9", "low = 129.4, high = 130.6"),
        ("low = 5.40, high = 5.70", "low = 4.84, high = 5.11"),
    )
    with bench_composed() as made:
        result = execute(leak_down, made.bench, tmp_path / "out", specimen=read_specimen(path))
        assert made.bench.rig.nominal_preload == pytest.approx(130 * kN)
    assert result.verdict is Outcome.PASS, result.reason
    assert read_result(tmp_path / "out").specimen.serial_number == "0815 <&>"
    assert b'name="specimen serial number" value="0815 &lt;&amp;&gt;"' in junit(result)
    page = write_report(tmp_path / "out").read_text(encoding="utf-8")
    head = page[: page.index("</header>")]
    for name, text in (("specimen", "diaphragm spring 575"), ("serial number", "0815 &lt;&amp;&gt;")):
        assert f"<dt>{name}</dt><dd>{text}</dd>" in head


def test_a_specimen_that_does_not_say_what_is_good_blocks_the_plan_before_anything_moves(
    tmp_path, bench_composed
):
    @plan(setup=lambda run: None, teardown=lambda run: None)
    def unknown_load(run: Run) -> None:
        """A load that the specimen does not have."""
        run.specimen.load("AW9")

    with bench_composed() as made:
        result = execute(unknown_load, made.bench, tmp_path)
    assert result.verdict is Outcome.BLOCKED
    assert result.reason == "the specimen's file: specimen astb.toml has no load case AW9; it has AW0, AW3"


OWN = """
[limits.creep]
sag = { high = 0.5, unit = "mm", provenance = "assumed", source = "in ten minutes" }

[load_case.AW0.limits.creep.by_amplitude]
amplitude_mm = [2.0, 4.0]
expected = [1.0, 3.0]
tolerance = 0.1
unit = "kN"
provenance = "assumed"
source = "by hand"
"""


def test_needs_of_one_plan_are_in_a_table_with_its_name(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(TEXT + OWN, encoding="utf-8")
    one = read_specimen(path)
    assert one.limits.band("creep.sag", "mm") == Band(high=0.5 * mm)
    assert one.load("AW0").limits.curve_at("creep.by_amplitude", 3 * mm, "N") == pytest.approx((1800, 2200))
    assert one.limits.band("rest_height") == ordinary().limits.band("rest_height")
    with pytest.raises(SpecimenError, match=r"limits has no limit of creep\.set"):
        one.limits.band("creep.set", "mm")


@pytest.mark.parametrize(
    ("unit", "told"), [("bar", "has the unit m, but the plan needs bar"), ("", "needs no unit")]
)
def test_a_plan_that_takes_its_own_limit_for_another_quantity_is_refused(tmp_path, unit, told):
    path = tmp_path / "own.toml"
    path.write_text(TEXT + OWN, encoding="utf-8")
    with pytest.raises(SpecimenError, match=told):
        read_specimen(path).limits.band("creep.sag", unit)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('unit = "mm"', 'unit = "ell"', "limits.creep.sag is in 'ell', which is not a known unit"),
        ("high = 0.5", "hihg = 0.5", "limits.creep.sag.hihg is not a key"),
        (
            "amplitude_mm = [2.0, 4.0]",
            "amplitude_mm = [4.0, 2.0]",
            "limits.creep.by_amplitude.amplitude_mm = [4.0, 2.0]",
        ),
    ],
)
def test_what_does_not_fit_in_the_table_of_a_plan_is_refused(tmp_path, old, new, told):
    path = tmp_path / "own.toml"
    path.write_text(TEXT + OWN.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(SpecimenError, match=re.escape(told)):
        read_specimen(path)
