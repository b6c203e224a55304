"""A rig as documents alone would build it: from its list to a passing leak-down as the page says, and no concession."""

import re
import struct
import tomllib
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from astb.acceptance.checking.examining import examine
from astb.acceptance.checking.moving import move_each
from astb.acceptance.checking.report import Plausibility
from astb.acceptance.skeleton.writing import skeleton
from astb.listening import Listening
from bench_protocol.dimensions import read_dimensions
from bench_protocol.table import TABLE
from bench_protocol.units import bar
from bench_records.result import Outcome
from drivers.bench import Bench
from drivers.errors import LinkLost, Refused
from drivers.modbus_port import InMemoryModbus
from drivers.wiring.described import open_described
from drivers.wiring.description import describe, read_description
from drivers.wiring.lines import listening
from test_plans import steps
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.run import Run
from test_plans.steps.shaking import LATERAL, LOOP_FREQUENCY, shake
from tests.foreign.virtual import VirtualYard
from tests.foreign.yard_rig import LIST, UNIT_ID, YardRig
from tests.refusals import refuses

pytestmark = pytest.mark.timeout(300)  # who comes first compiles the model
HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs/how-to/connect-a-rig.md"


def filled_in(text: str) -> dict:
    """The skeleton after the lines of the page are inserted; those of an existing key replace the old ones."""

    def merge(into: dict, lines: dict) -> None:
        for key, value in lines.items():
            if isinstance(value, dict) and isinstance(into.get(key), dict) and "absent" not in into[key]:
                merge(into[key], value)
            else:
                into[key] = value

    content = tomllib.loads(text)
    for block in re.findall(r"^```toml\n(.*?)^```", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL):
        if block.startswith("# yard_c/wiring.toml\n"):
            merge(content, tomllib.loads(block))
    return content


def test_the_page_leads_from_the_list_to_the_wiring_that_the_tests_run(tmp_path):
    text = skeleton(None, LIST, tmp_path)
    content = filled_in(text)
    found, all_signals = (
        sum("absent" not in one for one in file["signals"].values())
        for file in (tomllib.loads(text), content)
    )
    assert re.search(rf"\b{found}\b[^.]*\b{all_signals}\b[^.]*\bsignals\b", PAGE.read_text())
    assert content == tomllib.loads((HERE / "yard_c" / "wiring.toml").read_text())


def test_its_device_takes_functions_15_16_and_23_and_no_others_and_answers_as_unit_17():
    rig = YardRig()
    port = InMemoryModbus(rig.answer, UNIT_ID)
    for write in (lambda: port.write_coil(20, True), lambda: port.write_register(218, 1)):
        with refuses(Refused, "exception 1"):
            write()
    port.write_coils(20, [True])
    port.write_registers(200, [0xFFFF & -2000, 0xFFFF])
    assert struct.unpack("<i", struct.pack("<HH", *port.read_holding(200, 2))) == (-2000,)
    both = struct.pack(">HHHBBHHHHBHH", 1, 0, 15, UNIT_ID, 23, 100, 2, 200, 2, 4, 5, 0)
    assert rig.answer(both)[7:9] == bytes([23, 4])
    assert port.read_holding(200, 2) == [5, 0]
    for refused, code in (
        (lambda: port.read_holding(100, 33), 3),
        (lambda: port.read_holding(150, 4), 2),
        (lambda: port.write_registers(100, [0, 0]), 2),
        (lambda: port.write_coils(4, [True]), 2),
        (lambda: port.read_input(100, 2), 1),
    ):
        with pytest.raises(Refused, match=f"Modbus exception {code}"):
            refused()
    with pytest.raises(LinkLost):
        InMemoryModbus(rig.answer, 1).read_holding(100, 2)


@contextmanager
def bench_on(content):
    """A bench on the rig by a wiring with this content."""
    virtual = VirtualYard(seed=1)
    description = describe(content, HERE / "yard_c" / "wiring.toml", TABLE)
    with Bench(open_described("yard_c", description, {"plc": virtual.port}), virtual.clock) as one:
        one.dimensions = read_dimensions(HERE / "yard_c" / "dimensions.toml")
        yield one


@pytest.fixture
def bench(tmp_path):
    """A bench on the rig by the wiring that the list and the page make."""
    with bench_on(filled_in(skeleton(None, LIST, tmp_path))) as one:
        yield one


def test_chambers_that_are_shut_at_power_up_are_joined_before_air_comes_and_goes(bench):
    valves = ("left_reservoir", "right_reservoir", "dpv")
    run = Run(bench, SimpleNamespace(event=lambda *_, **__: None), dimensions=bench.dimensions)
    assert {getattr(bench.air, valve) for valve in valves} == {"off"}
    steps.power_up(run)
    assert {getattr(bench.air, valve) for valve in valves} == {"on"}
    bench.air.isolate_reservoirs()
    steps.depressurise(run)
    assert bench.air.left_reservoir == bench.air.right_reservoir == "on"


def test_a_value_unset_since_power_up_is_no_doubt(tmp_path):
    virtual = VirtualYard(seed=1)
    description = read_description(HERE / "yard_c" / "wiring.toml", TABLE)
    wiring = open_described("yard_c", listening(description), {"plc": virtual.port})
    with Listening(wiring, virtual.clock, 1.0) as one:
        report = examine(one)
    assert report.doubtful == []
    target = next(line for line in report.signals if line.name == "air.left_target")
    assert target.value == pytest.approx(-1.01325 * bar)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_each_axis_moves_as_the_list_says_and_it_is_built_as_its_file_says(bench):
    lines = move_each(bench)
    assert [f"{one.what}: {one.found}" for one in lines if one.verdict is Plausibility.DOUBTFUL] == []
    assert {"bolster mass", "spring half spacing"} <= {one.what for one in lines}


@pytest.mark.slow
def test_a_controller_that_stands_still_between_set_points_makes_no_triangle(tmp_path, monkeypatch):
    monkeypatch.setattr("test_plans.steps.shaking.TRIES", 1)
    for stream, told in (("20 ms", 0), ("50 ms", 1)):
        content = filled_in(skeleton(None, LIST, tmp_path))
        content["transports"]["plc"]["stream"] = stream
        with bench_on(content) as made:
            run = Run(made, SimpleNamespace(event=lambda *_, **__: None), dimensions=made.dimensions)
            made.arm()
            made.lateral.move_to(0.0)
            shake(run, "lateral", LOOP_FREQUENCY, LATERAL, "triangle")
        assert ["no clean triangle" in one for one in run.warnings] == [True] * told


@pytest.mark.slow
@pytest.mark.parametrize("plan", ["leak_down", "aw0"])
def test_plans_judge_it_as_our_own(bench, tmp_path, plan):
    result = execute(plans()[plan], bench, tmp_path / plan, rig="yard_c", seed=1)
    assert [one.name for one in result.checks if not one.passed] == []
    assert (result.verdict, list(result.warnings)) == (Outcome.PASS, [])
