"""The panel in a real browser, in front of a rig in real time: watch, hold, answer, stop, and come back."""

import re
import time

import pytest

from astb.live.door import NoRun, knock

pytestmark = pytest.mark.slow


def text_of(page, selector: str) -> str:
    return page.text_content(selector) or ""


def until(page, selector: str, words: str, within: float = 60.0) -> str:
    """Wait until an element is seen and has these words."""
    page.locator(selector).filter(has_text=re.compile(words)).first.wait_for(timeout=1000 * within)
    return text_of(page, selector)


def pictures(page) -> int:
    """How many pictures all plots together draw in the best of a few seconds: others use the machine, too."""
    count = []
    for _ in range(12):
        before = page.evaluate("window.astbPictures()")
        page.wait_for_timeout(1000)
        count.append(page.evaluate("window.astbPictures()") - before)
        if count[-1] >= 30:
            break
    return max(count)


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
    refused = until(commander, ".wrong", "40 mm")
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

    assert pictures(commander) >= 3 * 10, "three plots, ten pictures a second each"

    until(viewer, "#question", "Has the bolster moved")
    assert viewer.locator("#question button:enabled").count() == 0, "who only watches answers nothing"
    assert "watches" in text_of(viewer, "#seat")
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
    assert "shift" in report.value.content()


def test_the_software_stop_takes_the_rig_to_its_safe_position(commander, open_page, picture):
    viewer = open_page(command=False)
    start(commander)
    until(commander, "#question", "Has the bolster moved")
    viewer.click("#estop")
    until(viewer, "#news", "only watches")
    until(viewer, "#state", "ACTIVE")
    commander.click("#estop")
    until(commander, "#state", "DISABLED")
    until(viewer, "#last .verdict", "blocked")
    until(viewer, "#last", "STOP: the run took the bench to its safe position")
    picture(commander, "stopped")


def test_a_page_outlives_its_server_and_so_does_the_run(commander, bench_panel, picture):
    start(commander)
    until(commander, "#question", "Has the bolster moved")
    bench_panel.kill()
    until(commander, "#news", "No word from the panel's server since", within=10)
    assert "stale" in commander.get_attribute("body", "class").split()
    picture(commander, "lost")
    snapshot = knock(bench_panel.rig_file, {"do": "look"})["snapshot"]
    assert snapshot["question"] == "Has the bolster moved?", "the run goes on without the panel"
    assert snapshot["state"] == "ACTIVE", "and the rig with it"
    bench_panel.start()
    commander.wait_for_selector("body:not(.stale)")
    until(commander, "#seat", "This page commands")
    commander.click("#question button >> text=no")
    until(commander, "#last .verdict", "pass")


def test_one_page_commands_and_another_may_take_over(commander, open_page):
    until(commander, "#seat", "This page commands")
    second = open_page()
    until(second, "#seat", "Another page commands")
    assert second.locator("#start:enabled").count() == 0
    second.click("#take")
    until(second, "#seat", "This page commands")
    until(commander, "#seat", "Another page commands")
