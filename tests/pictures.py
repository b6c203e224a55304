"""The words of a picture as a reader sees them: a browser gives the place of each."""

import re
from typing import Any, NamedTuple

import numpy as np
import pytest

#: Words of all drawings of a page: their corners on the screen, the axes and the legend in which they stand.
LOOK = """
() => [...document.querySelectorAll("svg")].map((drawing, number) => {
  const corners = (one, shrink) => {
    const box = one.getBBox(), m = one.getScreenCTM();
    const [top, bottom] = [box.y + shrink * box.height, box.y + (1 - shrink) * box.height];
    return [[box.x, top], [box.x + box.width, top], [box.x + box.width, bottom], [box.x, bottom]]
      .map(([x, y]) => [m.a * x + m.c * y + m.e, m.b * x + m.d * y + m.f]);
  };
  const frame = drawing.getBoundingClientRect();
  const id = (one, kind) => one.closest(`g[id*="${kind}"]`)?.id ?? "";
  return {
    name: drawing.id || `drawing ${number + 1}`,
    frame: [frame.left, frame.top, frame.right, frame.bottom],
    words: [...drawing.querySelectorAll("text")].filter(one => one.textContent.trim()).map(one => ({
      text: one.textContent.trim().replace(/\\s+/g, " "), corners: corners(one, 0.22),
      axes: id(one, "axes_"), legend: id(one, "legend_"),
    })),
    axes: [...drawing.querySelectorAll('g[id*="axes_"]')].map(one => ({
      id: one.id, corners: one.querySelector("path") ? corners(one.querySelector("path"), 0) : null,
    })).filter(one => one.corners),
  };
})
"""
#: The words of the bench's drawing that are seen, as `faults` wants them, and how many readings it has.
BENCH_WORDS = """() => {
  const svg = document.querySelector("svg.bench"), frame = svg.getBoundingClientRect();
  const corners = (one) => {
    const box = one.getBBox(), m = one.getScreenCTM();
    const [top, bottom] = [box.y + 0.22 * box.height, box.y + 0.78 * box.height];
    return [[box.x, top], [box.x + box.width, top], [box.x + box.width, bottom], [box.x, bottom]]
      .map(([x, y]) => [m.a * x + m.c * y + m.e, m.b * x + m.d * y + m.f]);
  };
  const seen = [...svg.querySelectorAll("text")].filter((one) => one.textContent.trim() && one.checkVisibility());
  const words = seen.map((one) => ({ text: one.textContent, corners: corners(one), axes: "", legend: "" }));
  return { name: "bench", axes: [], words, values: svg.querySelectorAll(".value").length,
    frame: [Math.max(0, frame.left), frame.top, Math.min(innerWidth, frame.right), frame.bottom] };
}"""
MARKUP = re.compile(r"\$|\\[a-z]|\{|\}|</?[a-z]+>|&[a-z]+;")
#: Letters may touch their neighbours by so much (px).
TOUCH = 1.0


class Word(NamedTuple):
    """A text in a drawing."""

    text: str
    corners: np.ndarray
    axes: str
    legend: str


def faults(drawing: dict[str, Any]) -> list[str]:
    """Return the errors in the words of a drawing, as reported by `LOOK`; empty if there are none."""
    words = [
        Word(one["text"], np.array(one["corners"]), one["axes"], one["legend"]) for one in drawing["words"]
    ]
    axes = {one["id"]: np.array(one["corners"]) for one in drawing["axes"]}
    left, top, right, bottom = drawing["frame"]
    found = [f"markup: {one.text}" for one in words if MARKUP.search(one.text)]
    for one in words:
        (x0, y0), (x1, y1) = one.corners.min(axis=0), one.corners.max(axis=0)
        if x0 < left - TOUCH or y0 < top - TOUCH or x1 > right + TOUCH or y1 > bottom + TOUCH:
            found.append(f"outside the picture: {one.text}")
        for name, panel in axes.items():
            inside = panel.min(axis=0) - TOUCH <= one.corners
            within = bool((inside & (one.corners <= panel.max(axis=0) + TOUCH)).all())
            if name == one.axes and one.legend and not within and overlap(one.corners, panel):
                found.append(f"leaves its axes: {one.text}")
    for place, one in enumerate(words):
        for other in words[place + 1 :]:
            if overlap(one.corners, other.corners):
                found.append(f"on each other: {one.text} / {other.text}")
    return found


def overlap(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two rectangles, turned or not, share more than a touch: no line of their edges keeps them apart."""
    for edge in (*(one[1:3] - one[:2]), *(other[1:3] - other[:2])):
        length = float(np.hypot(*edge))
        if length == 0.0:
            return False
        normal = edge / length
        mine, theirs = one @ normal, other @ normal
        if min(mine.max(), theirs.max()) - max(mine.min(), theirs.min()) <= TOUCH:
            return False
    return True


def in_a_second(page: Any, count: str, enough: int) -> int:
    """How far what a page counts goes in the best of a few seconds, since others use the machine, too.

    The first second in which it is ``enough`` is good.
    """
    counted = 0
    for _ in range(12):
        before = page.evaluate(count)
        page.wait_for_timeout(1000)
        counted = max(counted, page.evaluate(count) - before)
        if counted >= enough:
            break
    return counted


def inaccessible(page) -> list[str]:
    """Return what axe-core finds wrong with a page, in the light and in the dark."""
    api = pytest.importorskip("axe_playwright_python.sync_playwright", reason="`make` installs axe-core")
    found = []
    for scheme in ("dark", "light"):
        page.emulate_media(color_scheme=scheme)
        for one in api.Axe().run(page).response["violations"]:
            found += [f"{scheme}: {one['id']} {node['html'][:120]}" for node in one["nodes"]]
    return found
