"""The panel in a real browser, in front of a rig in real time: watch, hold, answer, stop, and come back."""

import re
import time
from pathlib import Path

import pytest

from astb.live.door import NoRun, knock
from tests.pictures import in_a_second

pytestmark = pytest.mark.slow

PHOTO = Path(__file__).parents[2] / "docs" / "gallery" / "panel-lost.png"


#: Whether anything in the head of the page lies over its neighbour.
OVERLAPS = """() => {
  const boxes = ["#state .word", ".rig", "#views", "#seat", "#estop"]
    .map((one) => document.querySelector(one).getBoundingClientRect());
  const apart = (a, b) => a.right <= b.left || b.right <= a.left || a.bottom <= b.top || b.bottom <= a.top;
  return boxes.some((a, i) => boxes.slice(i + 1).some((b) => !apart(a, b)));
}"""


def text_of(page, selector: str) -> str:
    return page.text_content(selector) or ""


def until(page, selector: str, words: str, within: float = 60.0) -> str:
    """Wait until an element is seen and has these words."""
    page.locator(selector).filter(has_text=re.compile(words)).first.wait_for(timeout=1000 * within)
    return text_of(page, selector)


def start(page, **values: str) -> None:
    page.select_option("select[aria-label=plan]", "shift")
    for name, value in values.items():
        page.fill(f"#set-{name}", value)
    page.click("#start:enabled")


def end_runs(page, panel) -> None:
    """Leave no run behind, whatever a test came to."""
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        try:
            knock(panel.rig_file, {"do": "stop"})
        except NoRun:
            return
        time.sleep(0.2)
    raise AssertionError("the run does not end")


@pytest.fixture
def commander(open_page, bench_panel):
    page = open_page()
    page.wait_for_selector("body:not(.stale)")  # after a server that was killed, the rig may just come back
    yield page
    end_runs(page, bench_panel)


def test_a_run_is_started_watched_held_answered_and_passes(commander, open_page, picture):
    start(commander, amplitude="40 mm")
    refused = until(commander, ".wrong[role=alert]", "40 mm")
    assert refused == "shift: amplitude = 40 mm is outside 5 to 30 mm", "in the words of the command line"
    commander.select_option("select[aria-label='what is plotted'] >> nth=1", "Actuator displacements")
    commander.select_option("select[aria-label='which loop']", label="Lateral force over displacement")
    commander.select_option("select[aria-label='how long'] >> nth=2", "20 s")
    start(commander, amplitude="12 mm")
    viewer = open_page(command=False, dark=True, size=(1600, 900))
    until(commander, "#question", "Has the bolster moved")
    until(commander, "#state", "ACTIVE")
    place = text_of(commander, "[data-signal='lateral.displacement'] .number")
    assert 11.0 < float(place) < 13.0, "the reading over the wires is where the plan went"

    commander.locator("svg.bench[aria-label*='lateral 12.']").or_(
        commander.locator("svg.bench[aria-label*='lateral 11.']")
    ).wait_for()  # and so it is in the drawing, whose words are a second old at most
    drawn = in_a_second(commander, "window.astbPictures()", enough=3 * 10)
    assert drawn >= 3 * 10, "three plots, ten pictures a second each"

    until(viewer, "#question", "Has the bolster moved")
    assert viewer.locator("#question button:enabled").count() == 0, "who only watches answers nothing"
    assert "only shows" in text_of(viewer, "#seat")
    picture(commander, "question")
    commander.click("#hold")
    commander.click("#question button >> text=yes")
    until(commander, ".run", "Held before look")
    until(viewer, ".run", "Held before look")
    picture(viewer, "held-dark")
    commander.click("#hold")
    until(commander, "#last .verdict", "pass")
    until(viewer, "#last .verdict", "pass")
    with commander.expect_popup() as report:
        commander.click("#last >> text=Report")
    report.value.wait_for_selector("html[data-plots=live]")  # its scripts may draw, and reach nothing
    assert "shift" in report.value.title()


def test_a_run_is_watched_by_its_model(commander, picture):
    commander.check("#twin")
    start(commander)
    # While the bench moves to its pose, the model says why it cannot judge; at the question it may judge again.
    until(
        commander,
        "#beside",
        r"No deviation from the model in .*of \d.*Not compared now: (the|a|it) ",
        within=90,
    )
    until(commander, "#question", "Has the bolster moved", within=90)
    picture(commander, "watched")


def test_a_page_outlives_its_server_and_stops_the_run_that_went_on(
    commander, bench_panel, open_page, picture
):
    commander.fill("input[aria-label=operator]", "A. Tester")
    start(commander)
    until(commander, "#question", "Has the bolster moved.*1:[0-2]\\d.min left to answer")
    bench_panel.kill()
    until(commander, "#news", "No data from the panel's server since", within=10)
    assert "stale" in commander.get_attribute("body", "class").split()
    picture(commander, "lost")
    snapshot = knock(bench_panel.rig_file, {"do": "look"})["snapshot"]
    assert snapshot["question"] == "Has the bolster moved?", "the run goes on without the panel"
    assert snapshot["state"] == "ACTIVE", "and the rig with it"
    bench_panel.start()
    commander.wait_for_selector("body:not(.stale)")
    until(commander, "#seat", "This page controls the rig")
    viewer = open_page(command=False)
    assert "not allowed from this page" in text_of(viewer, "#estop"), (
        "where it would do nothing it does not look as if"
    )
    assert viewer.locator("#estop.watching").count() == 1
    viewer.click("#estop")
    until(viewer, "#news", "can only watch")
    until(viewer, "#state", "ACTIVE")
    commander.click("#estop")
    until(commander, "#state", "DISABLED")
    until(viewer, "#last .verdict", "blocked")
    until(viewer, "#last", "the run was commanded to bring the bench to its safe position")
    told = until(viewer, ".stopped", "springs empty at")
    assert re.fullmatch(
        r"Stopped by A. Tester at \d+:\d\d:\d\d.*; springs empty at \d+:\d\d:\d\d.*\.", told
    ), told
    assert "exception" not in text_of(viewer, "#last")
    picture(commander, "stopped")


CARD = """async ([can_hold, failed, cannot_hold]) => {
  const { runCard } = await import("/page/run.js");
  const plan = { name: "aw0", title: "", lasts: 0, judges: true, parameters: [], checks: [] };
  const card = runCard({ plans: { plans: [plan], specimens: [], unusable: [] }, link: {} });
  const run = { plan: "aw0", step: [], checks: {}, answers: [], question: "", held: "", hold_wanted_by: "", said: "",
    answer_within: null, left: null, time: 0, fraction: 0 };
  card.tell({
    rig: { run: { ...run, can_hold, cannot_hold, failed }, link: "" },
    runs: {}, access: { seat: true },
  });
  const hold = card.element.querySelector("#hold");
  return [hold.hidden, hold.disabled && card.element.querySelector("#no-hold").textContent,
    card.element.querySelector(".failed")?.textContent ?? ""];
}"""


TITLE = (
    """async ([status, stale]) => (await import("/page/title.js")).tabTitle(status, stale, false, "hall")"""
)


def test_the_tab_says_what_waits_first_and_how_far_the_run_is(open_page):
    page = open_page()
    run = {"plan": "aw0", "fraction": 0.437, "question": "", "held": ""}

    def title(run, last=None, link="", stale=False):
        rig = {"run": run, "link": link, "state": "ACTIVE"}
        return page.evaluate(TITLE, [{"rig": rig, "runs": {"last": last}}, stale])

    assert title(None) == "hall – ASTB"
    assert title(run) == "43 % aw0 – hall – ASTB"
    assert title(run | {"question": "Fit the plate"}) == "❓ aw0: answer needed – hall – ASTB"
    assert title(run | {"held": "before the push"}) == "⏸ aw0 is held – hall – ASTB"
    assert title(None, {"verdict": "fail", "plan": "aw0"}) == "fail: aw0 – hall – ASTB"
    assert title(run, link="gone") == title(run, stale=True) == "⚠ no data – hall – ASTB"
    assert page.title().endswith(" – ASTB")


def test_a_card_offers_what_can_be_done_and_an_axis_has_the_decimals_of_its_step(open_page):
    page = open_page()
    assert page.evaluate(CARD, [True, [], ""]) == [False, False, ""]
    assert page.evaluate(CARD, [True, [], "no hold point after it"]) == [False, "no hold point after it", ""]
    hidden, _, failed = page.evaluate(CARD, [False, [f"height {n} = 12 mm: fail" for n in range(7)], "none"])
    assert hidden, "a plan that can be held nowhere has no such button"
    assert failed.startswith("height 0 = 12 mm: fail") and failed.endswith("and 2 more")
    ticks = """async ([values, step]) => (await import("/page/format.js")).ticks(values, step)"""
    assert page.evaluate(ticks, [[-27.5, -25.0, -22.5], 2.5]) == ["−27.5", "−25.0", "−22.5"]
    assert page.evaluate(ticks, [[-10, None, 0], 10]) == ["−10", "", "0"]
    assert page.evaluate(ticks, [[0.0005, 0.001], 0.0005]) == ["0.0005", "0.0010"]


def test_one_page_commands_and_another_may_take_over(commander, open_page):
    until(commander, "#seat", "This page controls the rig")
    commander.reload()
    until(commander, "#seat", "This page controls the rig")
    with commander.expect_popup() as opened:
        commander.evaluate("window.open(location.pathname)")
    until(
        opened.value, "#seat", "Another page controls the rig"
    )  # though it has a copy of what the first one keeps
    second = open_page()
    until(second, "#seat", "Another page controls the rig")
    assert second.locator("#start:enabled").count() == 0
    second.click("#take")
    until(second, "#seat", "This page controls the rig")
    until(commander, "#seat", "Another page controls the rig")


def test_a_stop_needs_no_page_and_an_open_connection_is_dropped(open_page):
    page, connections, waiting = open_page(), [], {}

    def connected(socket):
        connections.append(socket)
        if len(connections) > 1:  # the first one is mute, as where the network is gone
            socket.connect_to_server()

    def held(name):
        page.route(name, lambda route: waiting.update({name: route}))

    def let_go(name):
        deadline = time.monotonic() + 60
        while name not in waiting and time.monotonic() < deadline:
            page.wait_for_timeout(50)
        waiting[name].continue_()

    page.route_web_socket("**/api/stream*", connected)
    held("**/page/main.js")
    held("**/api/plans")
    page.reload(wait_until="commit")
    with page.expect_response("**/api/estop") as answer:
        page.click("#estop")  # before the rest of the page is loaded
    assert answer.value.ok, answer.value.text()
    let_go("**/page/main.js")
    until(page, "#news", "does not answer yet")
    with page.expect_response("**/api/estop") as answer:
        page.click("#estop")  # before the page has all that it shows
    assert answer.value.ok, answer.value.text()
    let_go("**/api/plans")
    page.wait_for_selector(".readings")
    until(page, "#state", "HOLD|DISABLED|AIR")
    page.wait_for_selector("body:not(.stale)")
    assert len(connections) == 2


def test_the_views_show_past_runs_and_diagnoses_faults_and_the_bus(open_page, bench_panel, keep):
    for name, value in (("one", 0.004), ("two", 0.005)):
        keep(bench_panel.out, name, value)
    diagnosis = bench_panel.out / "found"
    diagnosis.mkdir()
    (diagnosis / "report.html").write_text("the report of a diagnosis")
    (diagnosis / "finding.json").write_text(
        '{"verdict": "named", "sentence": "it <b>leaks</b>", "provenance": {"simulator": "the bench"}}'
    )
    page = open_page()
    until(page, "#seat", "This page controls the rig")
    assert not page.evaluate(OVERLAPS), "on a tablet"

    page.click("#views >> text=Runs")
    for name in ("one", "two"):
        page.check(f"input[aria-label='compare {name}']")
    beside = page.get_attribute("text=Compare these two", "href")
    assert beside == "/kept/compare?a=one&b=two"
    page.click("tr:has(a[href$='=one']) >> td >> nth=3")
    assert page.get_attribute(".check >> text=trend", "href") == "/kept/trend?run=one&place=0"
    page.click("text=Add a note, a photo or a file")
    page.fill("textarea[aria-label=note]", "a scratch")
    page.fill(".notes input[aria-label=operator]", "A. Tester")
    page.set_input_files("input[aria-label='photos or files']", PHOTO)
    page.click(".notes button >> text=Add")
    page.wait_for_selector(".note img")
    page.evaluate("document.querySelector('.note img').decode()")  # it is one, and is handed out
    assert "A. Tester" in page.text_content(".note small") and page.text_content(".note p") == "a scratch"
    until(page, "section[aria-label=runs]", "1 note")

    page.click("#views >> text=Diagnoses")
    until(page, "section[aria-label=diagnoses]", "It <b>leaks</b>")
    with page.expect_popup() as report:
        page.click("a[href$='=found']")
    until(report.value, "body", "the report of a diagnosis")

    page.click("#views >> text=Faults")
    page.click("[data-fault=leak] summary")
    page.click("[data-fault=leak] >> text=Switch on")
    until(page, "section[aria-label='faults that are on']", "leak")
    viewer = open_page(command=False)
    viewer.click("#views >> text=Faults")
    assert not viewer.locator("text=Switch off").first.is_enabled(), "an observer repairs nothing"
    page.click("text=Switch off")
    until(page, "section[aria-label='faults that are on']", "No fault is active")
    page.click("[data-fault=bias] summary")
    page.select_option("select[aria-label='bias sensor']", "right.height")
    assert page.get_attribute("input[aria-label='bias value']", "placeholder") == "-600 to 600 mm"
    page.fill("input[aria-label='bias value']", "3 mm")
    page.click("[data-fault=bias] >> text=Switch on")
    until(page, "section[aria-label='faults that are on']", "bias.right.height")
    page.click("text=Switch off")
    until(page, "section[aria-label='faults that are on']", "No fault is active")

    page.click("#views >> text=Bus")
    until(page, "section[aria-label=rig]", "Rig controlled by")
    until(page, "section[aria-label=frames] h2", "^[1-9].* frames/s")
