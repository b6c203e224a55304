"""A check of a rig: sound ones pass while another client commands them, and each wrong wiring is reported."""

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from astb.acceptance.checking.examining import WITHIN, examine
from astb.acceptance.checking.moving import move_each
from astb.acceptance.checking.report import Plausibility
from astb.cli import commands
from astb.listening import Listening
from astb.rig_in_memory import RigInMemory
from bench_protocol.dimensions import Dimensions
from bench_protocol.table import TABLE
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from drivers.bench import Bench
from drivers.errors import LinkLost
from drivers.wiring.described import open_described
from drivers.wiring.description import read_description
from drivers.wiring.own import own_wiring
from test_plans.discovery import plans
from tests.foreign import wiring_file
from tests.foreign.virtual import VirtualHall, VirtualPlc
from tests.refusals import refuses

HERE = Path(__file__).parent


def wired(virtual, tmp_path, *changes: tuple[str, str]):
    """The rig's description, with lines of its wiring file changed."""
    text = wiring_file(virtual.name).read_text()
    for was, becomes in changes:
        assert re.search(was, text, re.MULTILINE), was
        text = re.sub(was, becomes, text, flags=re.MULTILINE)
    for name in ("hall_b.dbc", "strangers.py"):
        (tmp_path / name).write_text((HERE / "hall_b" / name).read_text())
    path = tmp_path / "wiring.toml"
    path.write_text(text)
    return read_description(path, TABLE)


def report_of(virtual, description):
    wiring = open_described(virtual.name, description, {virtual.transport: virtual.port})
    with Listening(wiring, virtual.clock, WITHIN) as one:
        return examine(one)


def moves_of(virtual, description) -> list[str]:
    wiring = open_described(virtual.name, description, {virtual.transport: virtual.port})
    with Bench(wiring, virtual.clock) as bench:
        lines = move_each(bench)
        assert bench.state == "DISABLED"
    return [f"{one.what}: {one.found}" for one in lines if one.verdict is Plausibility.DOUBTFUL]


def test_our_rig_passes_and_its_commander_is_undisturbed():
    memory = RigInMemory(Rig(load(), seed=1))
    with memory.bench() as bench:
        bench.arm()
        with Listening(own_wiring(memory.can(), memory.modbus()), memory.clock, WITHIN) as one:
            report = examine(one)
        assert bench.state == "ACTIVE"
        assert bench.rig.strangers == 0
    assert report.state == "ACTIVE"
    assert report.doubtful == []
    assert "lease: the commander with token" in report.identity


@pytest.mark.slow
def test_our_rig_moves_as_it_says():
    memory = RigInMemory(Rig(load(), seed=1))
    with memory.bench() as bench:
        lines = move_each(bench)
    assert [one.what for one in lines if one.verdict is Plausibility.DOUBTFUL] == []
    assert "a push to the left moves to the left" in {one.what for one in lines}


@pytest.mark.parametrize(
    ("rig", "absent"), [(VirtualPlc, "lateral.acceleration"), (VirtualHall, "lateral.force")]
)
def test_a_strange_rig_is_sound_and_tells_what_it_lacks(rig, absent, tmp_path):
    virtual = rig()
    report = report_of(virtual, wired(virtual, tmp_path))
    assert report.doubtful == []
    lines = {one.name: one for one in report.signals}
    assert lines[absent].verdict is Plausibility.ABSENT
    assert lines[absent].remark.startswith("no ")
    assert lines["left.height"].rate == pytest.approx(20 if rig is VirtualPlc else 100, rel=0.03)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("rig", [VirtualPlc, VirtualHall])
def test_a_strange_rig_moves_as_its_wiring_says(rig, tmp_path):
    virtual = rig()
    assert moves_of(virtual, wired(virtual, tmp_path)) == []


def test_who_only_listens_keeps_no_rig_alive(tmp_path):
    """A watchdog that is fed by a listener would keep a bench running without its commander."""
    for virtual in (VirtualPlc(), VirtualHall()):
        sent = []
        if isinstance(virtual, VirtualPlc):
            answer = virtual.rig.answer
            virtual.rig.answer = lambda request, answer=answer, sent=sent: (
                sent.append(request[7]) or answer(request)
            )
        else:
            virtual.rig.receive = lambda identifier, data, sent=sent: sent.append(identifier)
        report_of(virtual, wired(virtual, tmp_path))
        assert not set(sent) - {2, 3, 4}


def test_a_missing_server_is_printed(tmp_path):
    virtual = VirtualHall()
    virtual.silent = True
    with refuses(LinkLost, "none"):
        report_of(virtual, wired(virtual, tmp_path))


RIGHT_ONE = (r'("left.height" = .*)laser_left', r"\1laser_other")
LEFT_ONE = (r'("right.height" = .*)laser_right"', r'\1laser_left"')
SWAPPED = [RIGHT_ONE, LEFT_ONE, ("laser_other", "laser_right")]
ABSOLUTE = (r'("left.bellows_pressure".*), calibration.*\}', r"\1 }")
TWICE = (r'("plc.chamber_left", unit = "mbar")', r'\1, calibration = { offset = "-1013 mbar" }')
TURNED = (r'(laser_left", unit = "mm"), sign = -1(.*)-400', r"\1\2-400")


def sign(signal: str) -> tuple[str, str]:
    return rf'("{signal}" = .*) \}}$', r"\1, sign = -1 }"


def scale(point: str, factor: float) -> tuple[str, str]:
    return rf"^({point} = .*int32\")", rf"\1, scale = {factor}"


@pytest.mark.parametrize(
    ("rig", "change", "signal", "remark"),
    [
        (VirtualHall, ABSOLUTE, "left.bellows_pressure", "an absolute pressure"),
        (VirtualPlc, TWICE, "left.auxiliary_pressure", "remove the offset"),
        (VirtualHall, (r"(CellsA.Cell1.*), sign = -1", r"\1"), "load_cell.1", "sign = -1"),
        (
            VirtualPlc,
            (r"(laser_left = .*scale = )0.01", r"\g<1>0.1"),
            "left.height",
            "out of its range|check (the )?scale",
        ),
        (VirtualPlc, scale("cell_3", 10), "load_cell.3", "check (the )?scale"),
        (VirtualPlc, (r'("plc.gas_left", unit = )"degC"', r'\1"K"'), "left.bellows_temperature", "degC"),
        (VirtualPlc, TURNED, "left.height", "check sign and offset|out of its range"),
    ],
)
def test_rest_shows_a_wrong_line(rig, change, signal, remark, tmp_path):
    virtual = rig()
    report = report_of(virtual, wired(virtual, tmp_path, change))
    assert signal in report.doubtful
    told = next(one.remark for one in report.signals if one.name == signal)
    assert re.search(remark, told), told


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (SWAPPED, "the left laser .* are the sides swapped"),
        ([scale("place_lateral", 10)], r"lateral\.displacement changed by (1\.9|2\.)\d* mm when 0\.2 mm"),
        ([sign("load_cell.5")], "load cells 5 and 6 hold against"),
        ([sign("lateral.displacement")], "the sign is wrong"),
        ([scale("force_lateral", 10)], "check the scale|lateral.force changed by"),
        ([sign("vertical_left.force")], "load cells 1 to 4 lose"),
        ([scale("cell_3", 2)], r"load_cell\.3 has its share"),
        ([sign("platform.roll")], "platform.roll follows .* the sign is wrong"),
    ],
)
def test_moves_show_a_wrong_line(changes, told, tmp_path):
    virtual = VirtualPlc()
    doubts = moves_of(virtual, wired(virtual, tmp_path, *changes))
    assert any(re.search(told, one) for one in doubts), doubts


def test_a_bench_that_cannot_be_moved_now_is_not_called_fine(tmp_path):
    virtual = VirtualPlc()
    wiring = open_described(virtual.name, wired(virtual, tmp_path), {virtual.transport: virtual.port})
    with Bench(wiring, virtual.clock) as bench:
        bench.arm()
        (line,) = move_each(bench)
    assert (line.verdict, line.found) == (Plausibility.DOUBTFUL, "the bench is ACTIVE, and not at rest")


def test_the_command_prints_a_table_and_json():
    result = CliRunner().invoke(commands, ["rig", "check", "virtual"])
    assert (result.exit_code, "all fine" in result.output) == (0, True), result.output
    result = CliRunner().invoke(commands, ["rig", "check", "virtual", "--json"])
    assert json.loads(result.stdout)["state"] == "DISABLED"


def test_a_rig_on_which_no_plan_can_run_says_so_first_and_ends_with_4(tmp_path):
    """Each missing name stands once, with all plans that it blocks."""
    virtual = VirtualPlc()
    description = wired(virtual, tmp_path, (r'^"left.height" = .*$', '"left.height" = { absent = "stolen" }'))
    report = report_of(virtual, description)
    assert report.plans == len(plans())
    assert report.blocked == sorted(name for name, one in plans().items() if "left.height" in one.needs)
    named = [name for one in report.missing for name in one.names]
    assert len(named) == len(set(named)) and "left.height" in named
    assert report.summary[0] == f"{report.plans - len(report.blocked)} of {report.plans} plans can run"
    assert "all fine" not in report.summary


def test_the_command_ends_with_4_where_dimensions_keep_plans_from_beginning(monkeypatch):
    monkeypatch.setattr("astb.session.dimensions_of", lambda *_: Dimensions())
    result = CliRunner().invoke(commands, ["rig", "check", "virtual"])
    assert (result.exit_code, "all fine" in result.output) == (4, False), result.output
    assert result.output.index("plans can run") < result.output.index("load_cell.1")


def test_a_bench_whose_rest_is_doubtful_is_not_moved(monkeypatch):
    monkeypatch.setattr("astb.acceptance.checking.examining.doubts", lambda *_, **__: {"left.height": "no"})
    monkeypatch.setattr("astb.acceptance.commands.check_rig._move", lambda *_: pytest.fail("it was moved"))
    result = CliRunner().invoke(commands, ["rig", "check", "virtual", "--allow-motion"])
    assert (result.exit_code, "The rig is not moved" in result.output) == (1, True), result.output
