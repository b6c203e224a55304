"""The picture of the bench in every state of a real rig, and of strange ones: each word is seen, whole and alone."""

import os
from contextlib import ExitStack, contextmanager
from pathlib import Path

import msgspec
import pytest

from astb.rig_file import read
from astb.session import open_wiring, wiring_of
from bench_protocol.clock import RealClock
from bench_protocol.table_signals import MEASUREMENTS
from bench_protocol.units import bar, mm, s
from bench_sim.rig.control_socket import ask, control_path
from drivers.bench import Bench
from tests.foreign.conftest import running, write_files
from tests.panel.conftest import PanelProcess
from tests.pictures import BENCH_WORDS, faults, in_a_second

pytestmark = [pytest.mark.slow, pytest.mark.real_time, pytest.mark.timeout(400)]

#: A desk, a laptop, a tablet held across and upright, a phone.
SIZES = {1800: 1000, 1280: 800, 1024: 768, 768: 1024, 390: 844}
#: Where the pictures go, to be looked at: ASTB_PICTURES=DIR.
PICTURES = os.environ.get("ASTB_PICTURES", "")
#: The legends of the plots, and which of them is cut or leaves its card.
CUT = """() => {
  const beyond = (one) => one.scrollWidth > one.clientWidth + 1 || one.scrollHeight > one.clientHeight + 1
    || one.getBoundingClientRect().right > one.closest(".card").getBoundingClientRect().right;
  const legends = [...document.querySelectorAll(".plots .legend")].filter((one) => one.textContent);
  return { legends: legends.length, cut: legends.filter(beyond).map((one) => one.textContent) };
}"""

#: Whether so many readings are crossed out, and no other.
LACKING = "(many) => document.querySelectorAll('svg.bench .label.lacking').length === many"


def looked_at(page, name: str, dark: bool = False) -> None:
    """See at every size that no word of the drawing lies on another or is cut, and keep pictures where asked."""
    page.emulate_media(color_scheme="dark" if dark else "light")
    for width, height in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(400)
        if PICTURES:
            page.locator(".card.picture").scroll_into_view_if_needed()
            page.screenshot(path=Path(PICTURES) / f"{name}-{width}{'-dark' if dark else ''}.png")
        found = page.evaluate(BENCH_WORDS)
        assert found["values"] > 12, "the drawing is there"
        assert faults(found) == [], (name, width)
        assert page.evaluate(CUT)["cut"] == [], (name, width)


def seen(page, *states: str, within: float = 15.0) -> None:
    """Wait until the page shows one of these states."""
    words = [one.replace("_", " ") for one in states]
    text = "(words) => words.includes(document.querySelector('#state .word').textContent)"
    page.wait_for_function(text, arg=words, timeout=1000 * within)


def stands(page, how: str, *names: str) -> None:
    """Wait until these readings are drawn so: ``lacking``, ``over``, ``first``."""
    for name in names:
        page.wait_for_selector(f"svg.bench .{how}[data-signal='{name}']", state="attached", timeout=15_000)


@contextmanager
def broken(rig, fault: str, **values: str):
    """Break a simulated rig on purpose while the block lasts."""

    def order(**what) -> None:
        answer = ask(control_path(rig.modbus.host, rig.modbus.port), msgspec.json.encode(what))
        assert b"error" not in answer, answer

    order(do="on", name=fault, values=values)
    try:
        yield
    finally:
        order(do="off", name=".".join([fault, *(values[one] for one in ("sensor",) if one in values)]))


@pytest.fixture
def commander(bench_panel):
    """The commander of the rig that the page shows."""
    rig = read(bench_panel.rig_file)
    with Bench(open_wiring(rig, bench_panel.rig_file), RealClock()) as bench:
        yield bench, rig


def test_the_picture_in_every_state_of_the_rig(open_page, commander) -> None:
    bench, rig = commander
    page = open_page(command=False)
    page.wait_for_selector("body:not(.stale)")
    for state in ("AIR_LOW", "AIR_HIGH", "HOLD", "ACTIVE"):
        bench.arm(to=state)
        seen(page, state)
        looked_at(page, state.lower())

    bench.vertical.move_to(-20 * mm, -45 * mm, rate=60 * mm / s)
    bench.lateral.move_to(30 * mm, rate=60 * mm / s)
    bench.air.fill(2 * bar, within=60 * s)
    magnified = "select[aria-label='how much the motion is magnified']"
    page.select_option(magnified, "3")
    looked_at(page, "tilted")
    looked_at(page, "tilted", dark=True)
    page.select_option(magnified, "1")

    gone = ("load_cell.5", "left.auxiliary_temperature", "lateral.acceleration")
    with ExitStack() as faulty:
        for name in gone:
            faulty.enter_context(broken(rig, "broken_wire", sensor=name, reads="nothing"))
        stands(page, "lacking", *gone)
        looked_at(page, "missing")
        looked_at(page, "missing", dark=True)

    with bench.despite_faults(), broken(rig, "bias", sensor="right.height", value="-110 mm"):
        seen(page, "FAULT_REACTION", "FAULT_DISABLED")
        stands(page, "over.first", "right.height")
        assert page.locator("svg.bench .air.over[data-part='right spring']").count() == 1
        looked_at(page, "limit")
        looked_at(page, "limit", dark=True)
    bench.arm()
    with bench.silent("set-points"):
        seen(page, "FAULT_HOLD")
    seen(page, "FAULT_HOLD", "FAULT_DISABLED")
    looked_at(page, "fault_hold")
    with bench.despite_faults(), broken(rig, "estop"):
        seen(page, "ESTOP")
        looked_at(page, "estop")
        looked_at(page, "estop", dark=True)
    bench.reset()
    seen(page, "DISABLED")
    looked_at(page, "disabled")
    bench.action.power_off()
    seen(page, "OFF")
    looked_at(page, "off")
    bench.action.power_on()
    seen(page, "DISABLED", within=30)


@pytest.mark.parametrize("name", ["plant_a", "hall_b", "yard_c"])
def test_the_picture_of_a_rig_that_is_described(browser, tmp_path, name) -> None:
    with running(name) as address:
        rig_file = write_files(name, address, tmp_path)
        absent = {one.name for one in MEASUREMENTS} & set(wiring_of(read(rig_file), rig_file).absent)
        assert absent, "it lacks something"
        panel = PanelProcess(tmp_path, rig_file)
        page = browser.new_page()
        try:
            page.goto(panel.watching)
            page.wait_for_selector(".readings")
            page.wait_for_selector("body:not(.stale)")
            drawn = set(
                page.eval_on_selector_all("svg.bench .label", "(all) => all.map((one) => one.dataset.signal)")
            )
            stands(page, "lacking", *(absent & drawn))
            page.wait_for_function(LACKING, arg=len(absent & drawn))
            looked_at(page, name)
            looked_at(page, name, dark=True)
        finally:
            page.close()
            panel.stop()


def test_the_bench_is_drawn_ten_times_a_second_at_the_size_of_a_desk(open_page) -> None:
    page = open_page(command=False, size=(1800, 1000))
    page.wait_for_selector("body:not(.stale)")
    assert in_a_second(page, "window.astbDrawn", enough=9) >= 9


def test_no_legend_of_a_plot_is_cut_at_any_size(open_page) -> None:
    page = open_page(command=False)
    page.wait_for_selector("body:not(.stale)")
    what = page.locator("select[aria-label='what is plotted']").first
    panels = what.evaluate("(one) => [...one.options].map((option) => option.value)")
    assert len(panels) > 8
    for width, height in (SIZES | {900: 800}).items():
        page.set_viewport_size({"width": width, "height": height})
        for panel in panels:
            what.select_option(panel)
            found = page.evaluate(CUT)
            assert found["legends"] >= 2
            assert found["cut"] == [], (width, panel)
