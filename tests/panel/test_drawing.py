"""The bench as a drawing, in a real browser: the position of its bodies for given readings, and its texts."""

import math
import random
from pathlib import Path

import msgspec
import pytest

import bench_records
from astb.panel.signals import shown_signals
from astb.panel.watch import Watch
from astb.rig_file import RigFile, Simulation, read
from astb.rig_limits import known_limits
from bench_protocol.dimensions import ordinary
from bench_protocol.table_signals import MEASUREMENTS
from tests.foreign.conftest import running, write_files
from tests.pictures import BENCH_WORDS, faults

pytestmark = pytest.mark.slow

ASSETS = Path(bench_records.__file__).parent / "assets"
DIMENSIONS = {name: one.value for name, one in ordinary().known.items()}
SIGNALS = msgspec.to_builtins(shown_signals(known_limits(RigFile("test", simulation=Simulation()))))
FACTOR = {one["name"]: one["factor"] for one in SIGNALS}

#: Where points of the drawing stand, in m: corners of the springs, ends of the lasers' beams, the lateral actuator.
POSES = """([dimensions, many]) => {
  const { layout, pose, point, corners } = window.benchDrawing;
  const at = layout(dimensions);
  return many.map(([told, times]) => {
    const now = pose(at, told, times);
    return { times: now.times, seen: now.seen,
      springs: [-1, 1].map((way) => corners(at, now, way)),
      beams: at.lasers.map((left) => [point(now.platform, -left, 0), point(now.bolster, -left, -at.centre)]),
      arm: point(now.bolster, 0, at.arm) };
  });
}"""
SHOW = """([dimensions, signals, look, times]) => {
  document.body.replaceChildren();
  const drawing = new window.benchDrawing.Drawing(document.body, { dimensions, signals });
  drawing.times = times;
  drawing.show(look);
  window.drawing = drawing;
  const told = ({ value, group, hint }) => [value.textContent, group.getAttribute("class"), hint.textContent];
  return { alternative: drawing.alternative,
    labels: Object.fromEntries([...drawing.labels].map(([name, one]) => [name, told(one)])),
    valves: [...drawing.svg.querySelectorAll(".valve")].map((one) => one.getAttribute("class")),
    over: [...drawing.svg.querySelectorAll(".air.over")].map((one) => one.dataset.part) };
}"""
#: What a second picture changes in the page, and how long a picture takes (ms).
AGAIN = """([look]) => {
  let built = 0;
  const elements = (all) => all.filter((one) => [...one.addedNodes].some((node) => node.nodeType === 1)).length;
  const seen = new MutationObserver((all) => (built += elements(all)));
  seen.observe(document.body, { childList: true, subtree: true });
  const before = document.querySelectorAll("*").length, began = performance.now();
  for (let k = 0; k < 100; k++) {
    for (const name of Object.keys(look.values)) look.values[name] = 10 * Math.sin(k / 9);
    window.drawing.show(look);
    document.body.getBoundingClientRect();
  }
  const took = (performance.now() - began) / 100;
  built += elements(seen.takeRecords());
  return [built, document.querySelectorAll("*").length - before, took];
}"""


#: As the page has it.
PLAIN = "body { margin: 0; font-family: 'Source Sans 3', 'Helvetica Neue', 'Liberation Sans', Arial, sans-serif; }"


@pytest.fixture
def sheet(browser):
    """An empty page with the drawing's script."""
    context = browser.new_context(viewport={"width": 1000, "height": 560})
    page, failures = context.new_page(), []
    page.on("pageerror", lambda error: failures.append(str(error)))
    page.add_style_tag(content=PLAIN)
    page.add_style_tag(path=ASSETS / "bench_drawing.css")
    page.add_script_tag(path=ASSETS / "bench_drawing.js")
    yield page
    context.close()
    assert not failures


#: Opens a run of 3 s with these readings, a column each; returns the instant (s), and how many readings lack there.
OPENED = """([signals, columns]) => {
  const told = { duration: 3, step: 0.1, dimensions: {}, settings: [], states: [], phases: [], trips: [], events: [],
    signals: signals.map((one) => ({ ...one, at: columns[one.name] ?? null })) };
  window.benchReplay(document.body, told, (at) => at);
  const lacking = [...document.querySelectorAll(".label.lacking title")].map((one) => one.textContent);
  return [Number(document.body.dataset.time), lacking.filter((text) => text.endsWith("has come")).length];
}"""


@pytest.mark.parametrize(
    ("late", "opens"),
    [
        ({"left.height": 0, "supply.pressure": 0}, 0.0),
        ({"left.height": 2, "supply.pressure": 7}, 0.7),
        ({"left.height": 4}, 0.4),
        ({"left.height": 99, "supply.pressure": 5}, 0.5),  # never comes
    ],
)
def test_a_replay_opens_at_the_first_instant_with_all_readings(sheet, late, opens) -> None:
    sheet.add_script_tag(path=ASSETS / "bench_replay.js")
    columns = {name: [None] * min(31, first) + [1.0] * max(0, 31 - first) for name, first in late.items()}
    time, lacking = sheet.evaluate(OPENED, [SIGNALS, columns])
    assert time == pytest.approx(opens)
    assert lacking == sum(first > 30 for first in late.values())


def test_bodies_are_placed_by_their_readings(sheet) -> None:
    chance = random.Random(41)
    half, up, lever = 1.15, 0.25, 0.35
    known = DIMENSIONS | {
        "spring_half_spacing": half,
        "left.height across": 0.9,
        "right.height across": -1.05,
        "centre_height": up,
        "lateral_actuator_height": lever,
        "column_height": 0.3,
    }
    many = []
    for _ in range(60):
        content = {f"{side}.height": chance.uniform(-0.02, 0.02) for side in ("left", "right")}
        moving = ("platform.roll", "platform.vertical", "platform.lateral", "lateral.displacement")
        content |= {name: chance.uniform(-0.01, 0.01) for name in moving}
        many.append([content, 1])
    for (content, _), found in zip(many, sheet.evaluate(POSES, [known, many]), strict=True):
        assert (found["seen"], found["times"]) == ("heights", 1)
        for side, (below, above) in zip(("left", "right"), found["beams"], strict=True):
            lean = content["platform.roll"]  # a laser looks at a right angle from the platform
            long = (above[0] - below[0]) * math.sin(lean) + (above[1] - below[1]) * math.cos(lean)
            assert long - 0.3 == pytest.approx(content[f"{side}.height"], abs=0.0012), (side, content)
        assert found["arm"][0] == pytest.approx(-content["lateral.displacement"], abs=1e-3), (
            "left is on the left"
        )
        theta = (content["left.height"] - content["right.height"]) / 1.95
        for way, (outer, inner, top_inner, top_outer) in zip((-1, 1), found["springs"], strict=True):
            middle = [(a + b) / 2 for a, b in zip(top_inner, top_outer, strict=True)]
            foot = [(a + b) / 2 for a, b in zip(outer, inner, strict=True)]
            height = content["left.height"] - theta * (
                0.9 + way * half
            )  # over the design height, at the spring
            assert middle[1] - foot[1] - 0.3 == pytest.approx(height, abs=0.0012)


def test_motion_is_magnified_to_fit_and_without_lasers_from_the_pistons(sheet) -> None:
    small = {"left.height": 0.004, "right.height": -0.002}
    large = {"left.height": 0.08, "right.height": -0.1}
    pistons = {"vertical_left.displacement": 0.01, "vertical_right.displacement": -0.01}
    asked = [[small, 1], [small, 10], [large, 10], [{"left.height": 0.01}, 1], [pistons, 1], [{}, 3]]
    one, ten, much, single, from_pistons, nothing = sheet.evaluate(POSES, [DIMENSIONS, asked])
    gap = [[spring[3][1] - spring[0][1] - 0.2 for spring in found["springs"]] for found in (one, ten)]
    assert ten["times"] == 10
    assert gap[1] == pytest.approx([10 * value for value in gap[0]], rel=0.02)
    assert 1 <= much["times"] < 10, "springs do not go through the platform"
    assert min(y for spring in much["springs"] for _, y in spring[2:]) > 0
    assert (single["seen"], from_pistons["seen"], nothing["seen"]) == ("heights", "pistons", "nothing")
    left, right = (spring[3][1] - spring[0][1] for spring in single["springs"])
    assert left == pytest.approx(right) and left == pytest.approx(0.21)
    left, right = ((spring[2][1] + spring[3][1]) / 2 for spring in from_pistons["springs"])
    assert (left, right) == (pytest.approx(0.21, abs=1e-3), pytest.approx(0.19, abs=1e-3))


def test_readings_are_placed_red_beyond_limits_and_crossed_out_if_missing(sheet) -> None:
    values = {one["name"]: 1.0 for one in SIGNALS} | {"right.height": -131.0, "left.bellows_pressure": 4.83}
    look = {
        "values": values,
        "first": "right.height",
        "lacking": {
            "lateral.acceleration": "no accelerometer on the bolster",
            "load_cell.3": "stale for 3 s",
        },
        "settings": {"air.left_mode": "fill", "air.right_mode": "hold", "air.dpv": "off"},
    }
    told = sheet.evaluate(SHOW, [DIMENSIONS, SIGNALS, look, 1])
    labels = told["labels"]
    pistons = {"vertical_left.displacement", "vertical_right.displacement"}  # the rods show them
    assert set(labels) == set(values) - pistons
    assert labels["left.bellows_pressure"][:2] == ["4.83 bar", "label"]
    assert labels["right.height"][:2] == ["−131.0 mm", "label over first"]
    assert told["over"] == ["right spring"]
    assert labels["lateral.acceleration"] == [
        "acceleration",
        "label lacking minor",
        "lateral acceleration: no accelerometer on the bolster",
    ]
    assert labels["load_cell.3"][1].startswith("label lacking")
    assert sorted(told["valves"]) == ["valve open", "valve shut", "valve shut"]
    for words in ("height −131.0 mm is beyond a limit", "no accelerometer", "valve fills", "valve shut"):
        assert words in told["alternative"]
    built, more, took = sheet.evaluate(AGAIN, [look])
    assert (built, more) == (0, 0), "only attributes and texts change"
    assert took < 50, "ten pictures a second leave half of the time to the rest"


#: The middle column of the page at 1800, 1280, 768 and 390 px.
WIDTHS = (1070, 700, 716, 356)
#: What benches are built like (m): the least and the most.
BUILT = {
    "spring_half_spacing": (0.85, 1.3),
    "centre_height": (0.18, 0.35),
    "lateral_actuator_height": (0.2, 0.5),
    "column_height": (0.15, 0.35),
}


def a_bench(chance: random.Random) -> dict[str, float]:
    """Dimensions of a possible bench."""
    built = {name: chance.uniform(*most) for name, most in BUILT.items()}
    half, beside = built["spring_half_spacing"], chance.uniform(0.0, 0.1)
    for way, side in ((1, "left"), (-1, "right")):
        built[f"{side}.height across"] = way * half
        built[f"vertical_{side} across"] = way * (half + beside)
    cells = half + chance.uniform(-0.2, 0.25)
    for n in (1, 2, 3, 4):
        built[f"load_cell.{n} across"] = cells if n % 2 else -cells
    return built


def test_no_word_lies_on_another_or_is_cut_whatever_is_read_on_whatever_bench(sheet) -> None:
    """With each reading at an end of its range, where it is longest, and with any of them missing."""
    chance = random.Random(4101)
    benches = [DIMENSIONS, *(a_bench(chance) for _ in range(12))]
    modes = ("hold", "level", "fill", "vent")
    for width in WIDTHS:
        sheet.set_viewport_size({"width": width, "height": 900})
        for known in benches:
            ends = {one.name: (one.low, one.high) for one in MEASUREMENTS}
            values = {name: chance.choice(both) / FACTOR[name] for name, both in ends.items()}
            gone = chance.sample(sorted(values), chance.choice((0, 0, 3, len(values))))
            look = {
                "values": values,
                "lacking": dict.fromkeys(gone, "nothing has come"),
                "settings": {f"air.{side}_mode": chance.choice(modes) for side in ("left", "right")},
            }
            sheet.evaluate(SHOW, [known, SIGNALS, look, chance.choice((1, 3, 10))])
            assert faults(sheet.evaluate(BENCH_WORDS)) == [], (width, known, look)


def test_a_described_rig_is_drawn_with_its_own_dimensions_and_says_what_it_lacks(sheet, tmp_path) -> None:
    with running("plant_a") as address:
        path = write_files("plant_a", address, tmp_path)
        watch = Watch(read(path), path)
        watch.start()
        try:
            for _ in range(200):
                if not watch.status.link and watch.status.valves:
                    break
                sheet.wait_for_timeout(50)
            status = msgspec.to_builtins(watch.present())
        finally:
            watch.close()
    assert watch.dimensions["spring_half_spacing"] != DIMENSIONS["spring_half_spacing"]
    values = {one["name"]: one["value"] for one in status["readings"]}
    look = {"values": values, "lacking": status["lacking"], "settings": status["valves"], "first": ""}
    told = sheet.evaluate(SHOW, [watch.dimensions, msgspec.to_builtins(watch.shown), look, 1])
    assert told["labels"]["lateral.acceleration"][2].endswith("no accelerometer on the bolster")
    assert told["labels"]["left.auxiliary_temperature"][2].endswith("no thermometer in the chambers")
    assert told["labels"]["left.height"][0].endswith(" mm")
    assert sheet.evaluate("drawing.at.spacing") == watch.dimensions["spring_half_spacing"]
    assert status["valves"]["air.left_mode"] in ("hold", "vent", "level", "fill")
