/** The card with the bench as a drawing, as it is now: readings at their places, ten pictures a second and more. */

import { make } from "/page/format.js";

const FRAME = 90; // ms: ten pictures a second and a little more

export const TIMES = [[1, "true motion"], [3, "motion × 3"], [10, "motion × 10"]];

export function picture(panel) {
  const names = panel.about.signals.map((one) => one.name);
  const place = make("div", { class: "drawing" });
  const drawing = new window.benchDrawing.Drawing(place, panel.about);
  const { element: times, said } = magnified(drawing);
  const values = {};
  let rig = {};
  let due = false;
  let drawn = 0;
  const show = () => {
    due = false;
    drawn = performance.now();
    drawing.show({ values, lacking: rig.lacking, settings: rig.valves, first: rig.tripped });
    said();
    window.astbDrawn = (window.astbDrawn ?? 0) + 1;
  };
  const soon = () => {
    if (!due) setTimeout(() => requestAnimationFrame(show), Math.max(0, drawn + FRAME - performance.now()));
    due = true;
  };
  const close = panel.link.trace(names, 1, 50, (first, width, fresh, low, high) => {
    names.forEach((name, row) => {
      const at = high[row].findLastIndex((value) => !Number.isNaN(value));
      if (at >= 0) values[name] = (low[row][at] + high[row][at]) / 2;
    });
    soon();
  });
  const assumed = drawing.at.assumed.length ? make("p", { class: "said" }, "The rig file does not state all dimensions. The drawing uses usual values for the others.") : null;
  return {
    element: make("div", { class: "card picture", "aria-label": "the bench" }, make("div", { class: "bar" }, times), place, assumed),
    tell(now) {
      rig = now;
      soon();
    },
    close,
  };
}

/** A choice of how much the motion is magnified, and what it says while pieces have less room than that. */
export function magnified(drawing) {
  const said = make("span", { class: "legend" });
  const select = make("select", { "aria-label": "how much the motion is magnified" }, ...TIMES.map(([value, text]) => make("option", { value }, text)));
  select.addEventListener("change", () => (drawing.times = Number(select.value)));
  return {
    element: make("div", { class: "bar" }, select, said),
    said() {
      const { times } = drawing.now;
      const text = times < drawing.times - 0.05 ? `only × ${times.toFixed(1)}, because the drawing has no more space` : "";
      if (said.textContent !== text) said.textContent = text;
    },
  };
}
