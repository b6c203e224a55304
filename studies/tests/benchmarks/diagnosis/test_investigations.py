"""Counted investigations: the rig has the drawn effects, a count can continue, and names are scored."""

import subprocess
import sys

import msgspec
import pytest

from astb.diagnose import with_roles
from astb.rig_file import read as read_rig_file
from astb.session import build_rig
from astb_studies.benchmarks.diagnosis import investigations
from astb_studies.benchmarks.diagnosis.ground_truth import GroundTruth, draw
from astb_studies.benchmarks.diagnosis.investigated import ROOT, Investigated, hidden_in, write_rig
from astb_studies.benchmarks.diagnosis.investigation_page import summary
from astb_studies.benchmarks.diagnosis.investigations import count, read
from astb_studies.benchmarks.diagnosis.lambda_per_unit import LambdaPerUnit
from astb_studies.benchmarks.diagnosis.sealed import measure, parameters_of
from bench_protocol.units import ms
from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from bench_sim.parameters.effects import find_effect
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.finding import Verdict
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.records import read_records
from test_plans.plans.separating import MENU
from test_plans.programmes.perform import programme_plan


@pytest.mark.parametrize(("seed", "kind"), [(300_000, "single"), (300_004, "pair"), (300_005, "null")])
def test_the_rig_that_is_investigated_has_what_was_drawn(seed, kind, tmp_path):
    truth = draw(seed, kind)
    rig, sealed = write_rig(truth, tmp_path)
    simulation = read_rig_file(rig).simulation
    if truth.effects:
        simulation = msgspec.structs.replace(simulation, sealed=str(sealed))
    built, drawn = build_rig(simulation).plant.parameter_array[0], parameters_of(truth).record
    for name in drawn.dtype.names:
        if name != "sensor_bias":  # a rig draws its own
            assert built[name] == pytest.approx(drawn[name], rel=1e-12, abs=1e-300), name


def test_a_faint_rig_has_a_fifth_of_a_near_miss():
    whole, faint = hidden_in(300_003, "near"), hidden_in(300_003, "faint")
    assert faint.effects.keys() == whole.effects.keys()
    assert faint.weakest == pytest.approx(0.2 * whole.weakest)
    (name,), shapes = whole.effects, LambdaPerUnit.read()
    for parameter, value in whole.effects[name].items():
        amplitude = parameter == find_effect(name)[0].amplitude.name
        assert faint.effects[name][parameter] == pytest.approx(value * (0.2 if amplitude else 1.0))
    assert shapes.part_apart(name, list(whole.effects[name].values())[1:]) < 1.0


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("plan", ["isolated_reservoirs", "leveling_on", "fast_vertical_sines"])
def test_a_sound_bench_stays_sound_where_chambers_are_shut_off_springs_are_fed_or_all_is_fast(
    plan, tmp_path, once
):
    """Effects of heat and of a zero error were reported as an unknown heat."""
    truth = GroundTruth(seed=7, kind="null", condition="white")
    simulator = AirSpring(load(), effects=CATALOGUE)

    def screened(record):
        measure(truth, record)
        return record

    measure(truth, tmp_path, programme_plan(MENU[plan]))
    data = with_roles(read_records([once("screening of a sound bench", screened), tmp_path], simulator))
    tried = ("heat", "pressure_gain", "auxiliary_volume", "leveling_deadband", "frame_compliance")
    finding = diagnose(data, simulator, Config(seed=7, workers=2, with_panel=False, effects=tried))
    assert finding.verdict is Verdict.NO_EFFECT, finding.sentence


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("hidden", "parameter", "size", "rival", "plan"),
    [
        ("force_lag", "lag", 0.12 * ms, "force_latency", "fast_lateral_sines"),
        ("force_latency", "delay", 0.12 * ms, "force_lag", "fast_lateral_sines"),
        ("pressure_lag", "lag", 0.3 * ms, "pressure_latency", "fast_vertical_sines"),
        ("pressure_latency", "delay", 0.3 * ms, "pressure_lag", "fast_vertical_sines"),
    ],
)
def test_fast_sines_distinguish_lag_from_latency(hidden, parameter, size, rival, plan, tmp_path):
    """A screening cannot: they differ by ω²τ²/2 in gain, a thousandth of a per cent of its forces.

    The sines are diagnosed without it: what else is seen owes it nothing.
    """
    truth = GroundTruth(seed=7, kind="single", condition="white", effects={hidden: {parameter: size}})
    simulator = AirSpring(load(), effects=CATALOGUE)

    def found(what=None):
        record = tmp_path / f"of {what and what.name}"
        measure(truth, record, what)
        data = with_roles(read_records([record], simulator))
        return diagnose(
            data, simulator, Config(seed=7, workers=2, with_panel=False, effects=(hidden, rival, "friction"))
        )

    if hidden.endswith("lag"):  # a screening cannot separate the two sides
        screened = found()
        assert screened.verdict is Verdict.AMBIGUOUS, screened.sentence
    shaken = found(programme_plan(MENU[plan]))
    assert shaken.verdict is Verdict.NAMED, shaken.sentence
    (cause,) = shaken.causes
    assert cause.effect == hidden
    (estimate,) = (one for one in cause.parameters if one.name == parameter)
    assert abs(estimate.value - size / ms) < 3.0 * estimate.sd
    assert estimate.sd < 0.02 * estimate.value


def one(seed, hidden, causes, rivals=(), first="named", **more):
    return Investigated(
        seed=seed,
        kind="single",
        hidden=hidden,
        weakest=50.0,
        causes=causes,
        rivals=list(rivals),
        first=first,
        verdict="named",
        **more,
    )


def test_what_counts_as_right_and_as_wrong():
    assert one(1, ["leak.left"], ["leak.left"]).right
    assert not one(2, ["leak.left"], ["leak.left"], rivals=["heat.left"]).right
    assert not one(3, ["leak.left"], ["leak.left"], failure="blocked").right
    assert one(4, [], []).right
    assert one(5, ["leak.left"], ["heat.left"]).wrong
    assert not one(6, ["leak.left"], ["leak_laminar.left"]).wrong  # next of kin
    assert not one(7, ["leak.left"], ["heat.left"], rivals=["leak.left"]).wrong


def test_a_count_goes_on_where_it_stopped(tmp_path, monkeypatch):
    kept, told, asked = tmp_path / "deep" / "kept.jsonl", [], []

    class Here:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

    def carried_out(_client, _function, cases):
        asked.extend(cases)
        for key, (seed, _) in cases.items():
            value = None if seed == 2 else one(seed, ["leak.left"], ["leak.left"], first="ambiguous")
            yield type("Ended", (), {"key": key, "value": value, "error": "died"})

    monkeypatch.setattr(investigations, "cluster", lambda workers: Here())
    monkeypatch.setattr(investigations, "carried_out", carried_out)
    count([(1, "single"), (2, "single")], 1, kept, told.append)
    count([(1, "single"), (2, "single"), (3, "single")], 1, kept, told.append)
    assert asked == ["single 1", "single 2", "single 3"]
    assert [known.seed for known in read(kept)] == [1, 2, 3]
    assert "died" in told[1]
    assert summary(read(kept))[0] == "with an effect: the right name: 2 of 2, 100 % (15.8 … 100)"
    assert "no verdict: 1 of 3" in summary(read(kept))[4]


@pytest.mark.slow
def test_a_rig_that_cannot_be_investigated_is_a_result_with_its_reason(tmp_path):
    kept, page = tmp_path / "kept.jsonl", tmp_path / "page.md"
    command = [
        sys.executable,
        "-m",
        "astb_studies.benchmarks.diagnosis.investigations",
        "--count",
        "1",
        "--processes",
        "1",
    ]
    done = subprocess.run(
        [*command, "--budget", "1 min", "--kept", str(kept), "--page", str(page)],
        check=True,
        capture_output=True,
        text=True,
        timeout=300,
        cwd=ROOT,
    )
    (known,) = read(kept)
    assert "budget = 1 min, but screening alone takes" in known.failure
    assert known.hidden and not known.right
    assert "no verdict: 1 of 1" in done.stdout
    assert "screening alone takes" in page.read_text(encoding="utf-8")
