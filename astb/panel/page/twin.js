/** The view of the twin: whether a run agrees with its model, and each deviation: start, size and possible causes. */

import { duration, fixed, make } from "/page/format.js";
import { Banded } from "/page/plots.js";
import { asked, choice, name, repeated, table } from "/page/tables.js";

const AGAIN = 1000; // ms until it is looked at anew
const NONE = "No run in this folder was compared with its model. To compare the next run, tick “compare with the model” before the start. To compare a recorded run, use `astb watch RUN`.";
const WORDS = { true: ["along", "agreed"], false: ["parted", "deviated"], null: ["blind", "not judged"] };
const COURSE = { told: "reported", surer: "narrowed down", otherwise: "changed" };
const FORMS = { "at once": "sudden", growing: "grows", "gone again": "temporary" };

export function show(element) {
  const runs = choice("run", "the newest", () => load());
  const card = make("section", { class: "view-twin", "aria-label": "twin" });
  const lately = new Lately();
  let seen = "";
  element.append(make("div", { class: "view" }, make("div", { class: "filters" }, runs.element), card));
  const cancel = repeated(load, AGAIN);
  return () => {
    cancel();
    lately.show(null, []);
  };

  async function load() {
    const { found, error } = await asked(`/api/twin${runs.value ? `?run=${encodeURIComponent(runs.value)}` : ""}`);
    const text = JSON.stringify([found, error]);
    if (text === seen) return;
    seen = text;
    lately.show(found?.story?.lately ?? null, (found?.story?.partings ?? []).filter((one) => one.lasts).map((one) => one.channel));
    if (error) return card.replaceChildren(make("p", { class: "wrong" }, error));
    runs.offer(found.runs);
    if (!found.story) return card.replaceChildren(make("p", { class: "card said" }, NONE));
    const { first, then } = told(found);
    card.replaceChildren(...first, lately.element, ...then);
  }
}

function told({ run, story }) {
  const partings = [...story.partings].reverse();
  const parted = partings.find((one) => one.lasts);
  const word = parted ? `Deviates from its model since ${at(parted.since)}` : story.judged_for ? "Agrees with its model" : "No part of the run could be compared with the model yet";
  const where = parted ? `in ${parted.channel}` : "";
  const head = make("section", { class: "card" },
    make("div", { class: `verdict-twin ${parted ? "parted" : story.judged_for ? "along" : "blind"}` }, word, where ? make("small", {}, ` ${where}`) : null),
    make("p", { class: "said" }, `${name(run)}: compared for ${duration(story.judged_for)} of ${duration(story.until)} with the model “${story.model}”`),
    stretches(story), legend());
  const blind = [...new Set(story.judged.filter((one) => one.along === null && one.why).map((one) => one.why))];
  const why = blind.length ? [make("section", { class: "card" }, make("h2", {}, "Why parts of the run were not judged"), make("ul", { class: "meanings" }, ...blind.map((one) => make("li", {}, one))))] : [];
  return { first: [head, ...partings.filter((one) => one.lasts).map((one) => parting(one, story.parts))], then: [...partings.filter((one) => !one.lasts).map((one) => parting(one, story.parts)), ...why] };
}

/** Every reading within the band in which its model expects it, over the last minute that could be judged. */
class Lately {
  constructor() {
    this.element = make("section", { class: "lately", "aria-label": "last minute" });
    this.plots = new Map();
  }

  show(minute, parted) {
    const names = minute ? minute.channels.map((one) => one.name) : [];
    if (names.join() !== [...this.plots.keys()].join()) this.arrange(minute);
    for (const one of minute?.channels ?? []) {
      const { plot, head, card } = this.plots.get(one.name);
      const last = one.measured.findLastIndex((value) => value !== null);
      const bands = last < 0 ? null : (one.measured[last] - one.expected[last]) / one.band[last];
      card.classList.toggle("parted", parted.includes(one.name));
      head.replaceChildren(
        make("b", {}, one.label), make("span", { class: Math.abs(bands) > 1 ? "far" : "" }, bands === null ? "not received" : beyond(bands)),
        make("small", {}, last < 0 ? "" : `${fixed(one.measured[last], one.decimals)} ${one.unit}, expected ${fixed(one.expected[last], one.decimals)} ± ${short(one.band[last])}`));
      plot.set(minute.times, one);
    }
  }

  arrange(minute) {
    for (const { plot } of this.plots.values()) plot.close();
    this.plots.clear();
    this.element.replaceChildren(...(minute ? [make("p", { class: "said" }, "The last judged minute; time of the run in s. Line: measured mean over 0.5 s. Dashed line: value of the model. Shaded: its uncertainty (k = 2).")] : []));
    for (const one of minute?.channels ?? []) {
      const [head, area] = [make("div", { class: "head" }), make("div", { class: "area" })];
      const card = make("div", { class: "card", "aria-label": one.label }, head, area);
      this.element.append(card);
      this.plots.set(one.name, { card, head, plot: new Banded(area, one) });
    }
  }
}

const at = (seconds) => `${fixed(seconds, 1)}\u2009s`;
const share = (part, whole) => `${(100 * Math.min(1, Math.max(0, part / Math.max(whole, 1e-9)))).toFixed(2)}%`;

/** The run as a strip: where it agreed, deviated, or could not be judged; a mark where a deviation began. */
function stretches({ judged, partings, until }) {
  // A stretch with a deviation agrees until the deviation begins.
  const cut = judged.flatMap((one) => {
    const since = partings.find(({ since }) => one.along === false && one.start < since && since < one.end)?.since;
    return since ? [{ ...one, along: true, end: since }, { ...one, start: since }] : [one];
  });
  const parts = cut.map((one) => make("i", { class: WORDS[one.along][0], style: `left:${share(one.start, until)};width:${share(one.end - one.start, until)}`, title: `${at(one.start)} to ${at(one.end)}: ${one.why || WORDS[one.along][1]}` }));
  const marks = partings.map((one) => make("b", { style: `left:${share(one.since, until)}`, title: `deviation since ${at(one.since)}, detected at ${at(one.told)}` }));
  return make("div", { class: "strip", role: "img", "aria-label": cut.map((one) => `${at(one.start)} to ${at(one.end)} ${WORDS[one.along][1]}`).join("; ") }, ...parts, ...marks);
}

function legend() {
  return make("p", { class: "said strip-legend" }, ...Object.values(WORDS).map(([kind, text]) => make("span", {}, make("i", { class: kind }), text)), make("span", {}, make("b"), "start of a deviation"));
}

/** How far a reading is from the model, in expanded uncertainties (k = 2). */
function beyond(bands) {
  return Math.abs(bands) > 1 ? `${fixed(Math.abs(bands), 1)} × uncertainty ${bands > 0 ? "above" : "below"} the model` : "within uncertainty";
}

function parting(one, parts) {
  const bands = (one.measured - one.expected) / one.band;
  const causes = [...one.causes.map((cause) => [cause]), ...one.pairs];
  const state = one.withdrawn ? "withdrawn" : one.over !== null ? `ended at ${at(one.over)}` : "no end detected";
  const began = one.earliest === null ? at(one.since) : `${at(one.since)} (${fixed(one.earliest, 1)} to ${fixed(one.latest, 1)})`;
  return make("section", { class: "card parting" },
    make("h2", { class: "title" }, one.channel, make("small", { class: one.lasts ? "parted" : "" }, ` ${state}`)),
    ...(one.summary ? Object.entries(parts).map(([part, label]) => make("p", { class: "said" }, make("b", {}, `${label}: `), one.summary[part])) : [make("p", { class: "said" }, one.sentence)]),
    make("div", { class: "facts" }, fact("measured", one.measured, one.unit), fact("expected", one.expected, one.unit, ` ± ${short(one.band)}`), make("div", { class: "fact" }, make("small", {}, "difference"), make("b", {}, beyond(bands))), make("div", { class: "fact" }, make("small", {}, "since"), make("b", {}, began))),
    residual(bands),
    causes.length
      ? table(["possible cause", "size (k = 2)", "over time", "since"], causes.map((some) => ({ cells: [lines(some, (c) => c.title), lines(some, (c) => c.shown), lines(some, (c) => (c.since === null && c.form === "at once" ? "constant" : FORMS[c.form] ?? c.form)), lines(some, (c) => (c.since === null ? "before the comparison" : some.length === 1 && c.form === "at once" ? at(one.since) : at(c.since) + (c.until === null ? "" : ` to ${at(c.until)}`)))] })))
      : make("p", { class: "said" }, "No known cause explains the deviation. Run `astb run screening`, then `astb diagnose`."),
    one.course.length ? make("p", { class: "said" }, "History: ", one.course.map((said) => `${COURSE[said.word] ?? said.word} at ${at(said.at)}${said.causes.length ? ` (${said.causes.map((c) => c.shown ? `${c.title} ${c.shown}` : c.title).join(" or ")})` : ""}`).join("; ")) : null);
}

const short = (value) => String(Number(value.toPrecision(2)));
const lines = (some, text) => make("span", {}, ...some.map((one, k) => make("span", { class: "line" }, k ? "and " : "", text(one))));

function fact(label, value, unit, more = "") {
  return make("div", { class: "fact" }, make("small", {}, label), make("b", {}, `${fixed(value, 3)}${more} `, make("small", {}, unit)));
}

/** The difference in units of the uncertainty, which is shaded, on a line that ends at ten of it. */
function residual(bands) {
  const place = (value) => share(value + 10, 20);
  return make("div", { class: "residual", role: "img", "aria-label": beyond(bands) }, make("i", { style: `left:${place(-1)};width:10%` }), make("b", { style: `left:${place(bands)}` }));
}
