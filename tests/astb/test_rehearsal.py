"""A rehearsal refuses what trips when it is run, for the same limit in the same step, and nothing else."""

from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from astb.cli import commands
from astb.exit_codes import REFUSED
from astb.rehearsal.envelope import step_at
from astb.rehearsal.page import PAGE, sentence, write_page
from astb.rehearsal.rehearsing import Rehearsal, rehearse
from astb.rig_file import RigFile, Simulation, read
from astb.session import open_session
from bench_protocol.named_files import label, named_files
from bench_protocol.units import Hz, mm, s
from bench_records.record import read as read_record
from bench_records.result import Outcome
from test_plans.execution import execute
from test_plans.parameters import Range
from test_plans.plan import plan
from tests.refusals import refuses

NOWHERE = Path("virtual.toml")


@plan
def sway(run, *, amplitude: Annotated[float, Range(1 * mm, 60 * mm, "mm")] = 10 * mm) -> None:
    """Sway the bolster to both sides."""
    with run.phase("begin"):
        run.bench.lateral.control = "displacement"
    with run.phase("sway"):
        run.bench.generator.run("lateral", amplitude=amplitude, frequency=2 * Hz, cycles=4)
        reached = run.bench.average("lateral.displacement", over=0.1 * s)
    run.check("rest", reached, "mm", low=-5 * mm, high=5 * mm)


def virtual(*limits: dict[str, str]) -> RigFile:
    return RigFile("virtual", time="virtual", simulation=Simulation(limits=limits))


def swayed(directory, amplitude, rig, **others):
    return rehearse(sway.given({"amplitude": f"{amplitude} mm"}), rig, NOWHERE, directory, **others)


def test_a_rehearsal_has_the_instruments_of_its_rig(tmp_path):
    files = []

    @plan(setup=lambda run: None, teardown=lambda run: None)
    def looks(run):
        """Look."""
        files.append(run.instruments.file)
        run.check("one", 1.0, "1", low=0.0)

    rehearse(looks, virtual(), NOWHERE, tmp_path)
    ordinary = named_files("instruments")["local"]
    (tmp_path / "ours.toml").write_text(ordinary.read_text(encoding="utf-8"), encoding="utf-8")
    rehearse(looks, msgspec.structs.replace(virtual(), instruments="ours.toml"), tmp_path / "rig", tmp_path)
    assert files == [label(ordinary), "ours.toml"]


def run(directory, amplitude, rig):
    """The record of an ordinary virtual run of the same plan, and its result."""
    with open_session(rig, NOWHERE) as session:
        session.bench.connect()
        result = execute(sway.given({"amplitude": f"{amplitude} mm"}), session.bench, directory)
    return read_record(directory), result


def tripped(record) -> tuple[str, float] | None:
    """Signal and time (s) of the first limit that tripped, as the rig sent it."""
    for event in record.events:
        if event.kind == "trip":
            return event.data["signal"], record.time_of(event)
    return None


UPPER = {"signal": "lateral.displacement", "kind": "upper", "at": "9.78 mm", "action": "program stop"}
LOWER = {"signal": "lateral.displacement", "kind": "lower", "at": "-10.24 mm", "action": "program hold"}
RATE = {"signal": "lateral.displacement", "kind": "rate", "at": "0.125 m/s", "action": "interlock"}
ERROR = {"signal": "lateral.displacement", "kind": "error", "at": "1.69 mm", "action": "program stop"}
AHEAD = UPPER | {"lead": "30 ms", "persistence": "5 ms", "at": "11.58 mm"}
LONG = UPPER | {"persistence": "120 ms", "at": "7.28 mm"}


@pytest.mark.parametrize(
    "limit",
    [UPPER, *(pytest.param(one, marks=pytest.mark.slow) for one in (ERROR, LOWER, RATE, AHEAD, LONG))],
    ids=lambda one: one["kind"],
)
def test_what_is_refused_trips_and_what_is_not_does_not(tmp_path, limit):
    rig, refused = virtual(limit), []
    for amplitude in (9.9, 10.2):
        found, directory = swayed(tmp_path / "rehearsed", amplitude, rig)
        record, result = run(tmp_path / f"run {amplitude}", amplitude, rig)
        seen = tripped(record)
        refused.append(found.refusal is not None)
        assert (seen is not None) is refused[-1]
        closest = next(
            row for row in found.limits if (row.signal, row.kind) == (limit["signal"], limit["kind"])
        )
        assert (closest.margin < 0.0) is refused[-1]
        if found.refusal and seen:
            assert found.refusal.signal == seen[0]
            assert found.refusal.time == pytest.approx(seen[1], abs=0.021), "the state comes at 50 Hz"
            assert found.refusal.step == step_at(result.phases, found.refusal.time) == "main › sway"
        else:
            ours = read_record(directory)
            assert all(
                np.array_equal(ours.series(name)[1], record.series(name)[1], equal_nan=True)
                for name in record.signals
            ), "who watches a rig changes nothing"
    assert set(refused) == {False, True}, "the amplitudes lie on both sides of the limit"


def test_the_envelope_is_that_of_a_recorded_run(tmp_path):
    rig = virtual()
    found, _ = swayed(tmp_path, 10.0, rig)
    record, result = run(tmp_path / "run", 10.0, rig)
    shown = {one.signal: one for one in found.envelope if not one.is_speed}
    for name in ("lateral.displacement", "lateral.force", "left.bellows_pressure", "supply.pressure"):
        times, values = record.series(name)
        assert (shown[name].low, shown[name].high) == (values.min(), values.max())
        assert shown[name].high_at == times[values.argmax()]
    assert found.duration == result.duration
    assert shown["lateral.displacement"].high_in == "main › sway"
    fastest = next(one for one in found.envelope if one.is_speed and one.signal == "lateral.displacement")
    assert fastest.high == pytest.approx(2 * np.pi * 2 * Hz * 10 * mm, rel=0.05)
    assert fastest.unit == "mm/s"
    assert found.air < 1e-5, "the springs stay empty"


def test_limits_are_sorted_by_margin_and_show_their_source(tmp_path):
    content = {"signal": "lateral.displacement", "kind": "upper", "at": "40 mm"}
    found, directory = swayed(tmp_path, 10.0, RigFile("hall", limits=(content,)))
    first = found.limits[0]
    assert (first.signal, first.kind, first.source) == ("lateral.displacement", "upper", "rig file")
    assert first.used == pytest.approx(10 / 40, abs=0.02)
    assert [one.used for one in found.limits] == sorted((one.used for one in found.limits), reverse=True)
    assert {one.source for one in found.limits[1:]} == {"assumed"}
    assert any("23 of 24 limits are assumed" in note for note in found.notes)
    text = write_page(found, directory).read_text(encoding="utf-8")
    assert "real rig" in text
    assert "40 mm" in text


def test_a_warning_limit_refuses_no_set_point(tmp_path):
    found, _ = swayed(tmp_path, 10.0, virtual(UPPER | {"at": "5 mm", "action": "indicate"}))
    assert found.refusal is None
    assert len(found.indicated) == 1
    assert "lateral displacement above 5 mm" in found.indicated[0]


def test_the_command_refuses_with_a_status_of_its_own_and_leaves_a_page(tmp_path):
    rig = tmp_path / "tight.toml"
    rig.write_text(
        'name = "tight"\ntime = "virtual"\n[[simulation.limits]]\nsignal = "left.bellows_pressure"\n'
        'kind = "upper"\nat = "3 bar"\n'
    )
    model = tmp_path / "extended.toml"
    model.write_text('based_on = "astb"\n[change]\ndischarge_coefficient = "0.63"\n')
    asked = ["rehearse", "leak_down", "--rig", str(rig), "--model", str(model), "--out", str(tmp_path)]
    ended = CliRunner().invoke(commands, asked)
    assert ended.exit_code == REFUSED, ended.output
    assert "leak_down: REFUSED: left bellows pressure above 3 bar for 20 ms, at 3.0" in ended.output
    assert "in set-up › raise the air at" in ended.output
    page = tmp_path / "leak_down-rehearsal" / PAGE
    assert "refused" in page.read_text(encoding="utf-8")
    kept = msgspec.json.decode((page.parent / "rehearsal.json").read_bytes(), type=Rehearsal)
    assert kept.refusal is not None
    assert kept.refusal.signal == "left.bellows_pressure"
    assert kept.model == "extended"


def test_what_a_real_rig_lacks_the_simulated_one_lacks_too(tmp_path):
    path = Path(__file__).parents[1] / "foreign" / "hall_b" / "rig.toml"
    asked = []

    @plan
    def ask(run) -> None:
        """Ask for a force that rig B does not have."""
        asked.append(run.can("lateral force", needs=["lateral.force"]))

    found, _ = rehearse(ask, read(path), path, tmp_path)
    assert asked == [False]
    assert found.verdict is Outcome.BLOCKED
    assert "no transducer in the lateral actuator" in found.reason
    assert sentence(found) == found.reason
    assert any("the simulated rig has no " in note and "lateral.force, " in note for note in found.notes)


def test_limits_of_a_simulated_rig_are_in_its_simulation(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text('name = "x"\nlimits = [{ signal = "left.height" }]\n[simulation]\n')
    with refuses(ValueError, "simulation"):
        read(path)
