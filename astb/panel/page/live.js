/** The live view: key readings with their limits, plots, the run, the interlocks. */

import { fixed, make, plain } from "/page/format.js";
import { picture } from "/page/picture.js";
import { OverSignal, OverTime } from "/page/plots.js";
import { runCard } from "/page/run.js";
import { help, LABELS } from "/page/words.js";

const SPANS = [[10, "10 s"], [30, "30 s"], [120, "2 min"], [600, "10 min"], [3600, "1 h"]];
const LOOPS = [
  ["left.height", "vertical_left.force", "Force over height, left"],
  ["right.height", "vertical_right.force", "Force over height, right"],
  ["lateral.displacement", "lateral.force", "Lateral force over displacement"],
  ["left.height", "left.bellows_pressure", "Pressure over height, left"],
];
const NEAR = 0.04; // of the way between two limits: so close is near
const ALARMS = ["estop", "pneumatic", "program", "limits", "fault"];
/** What each contact says: off, on. */
const CONTACTS = {
  estop: ["released", "pressed"], pneumatic: ["closed", "open"], program: ["closed", "open"], command: ["none", "received"],
  limits: ["none tripped", "tripped"], fault: ["none", "stored"], staged: ["none", "not applied yet"],
};
const AT_REST = ["pneumatic", "program"]; // open while the bench rests, as they should be

export function show(element, panel) {
  const signals = new Map(panel.about.signals.map((one) => [one.name, one]));
  const readings = panel.about.signals.filter((one) => one.key).map(reading);
  const locks = interlocks(panel.about.contacts);
  const run = runCard(panel);
  const drawing = picture(panel);
  const charts = [
    timeChart(panel, "Spring heights", 30),
    timeChart(panel, "Vertical actuator forces", 30),
    loopChart(panel, signals),
  ];
  element.append(
    make("div", { class: "live" },
      make("section", { class: "card readings", "aria-label": "readings" },
        ...readings.map((one) => one.element),
        panel.about.assumed ? make("p", { class: "said" }, "The rig file does not state all limits. The other limits are assumed values.") : null),
      make("section", { class: "plots" }, drawing.element, ...charts.map((one) => one.element)),
      make("section", { class: "side" }, run.element, locks.element)),
  );
  charts.forEach((one) => one.begin());
  const leave = panel.link.listen(() => {
    const { rig } = panel.link.status ?? {};
    if (!rig) return;
    const values = new Map(rig.readings.map((one) => [one.name, one.value]));
    readings.forEach((one) => one.tell(values.get(one.name) ?? null));
    drawing.tell(rig);
    locks.tell(rig);
    run.tell(panel.link.status);
  });
  return () => {
    leave();
    drawing.close();
    charts.forEach((one) => one.close());
  };
}

function reading(signal) {
  const number = make("span", { class: "number" }, "–");
  const mark = make("i", { hidden: true });
  const limited = signal.low !== null && signal.high !== null;
  const one = !limited && (signal.low ?? signal.high);
  const element = make("div", { class: "reading", "data-signal": signal.name },
    make("span", { class: "label" }, signal.label + (typeof one === "number" ? `, ${signal.low === null ? "at most" : "at least"} ${fixed(one, signal.decimals)}` : "")),
    number,
    make("span", { class: "unit" }, signal.unit),
    limited ? make("div", { class: "scale" }, plain(signal.low), make("div", { class: "bar" }, mark), plain(signal.high)) : null);
  return {
    name: signal.name,
    element,
    tell(value) {
      number.textContent = fixed(value, signal.decimals);
      const rest = value === null ? 1 : margin(signal, value);
      element.classList.toggle("over", rest <= 0);
      element.classList.toggle("near", rest > 0 && rest < NEAR);
      mark.hidden = value === null;
      if (limited && value !== null) mark.style.left = `${100 * clamp((value - signal.low) / (signal.high - signal.low))}%`;
    },
  };
}

const clamp = (share) => Math.min(1, Math.max(0, share));

/** How far a value is from the nearest of its limits, as a part of the way between them. */
function margin({ low, high }, value) {
  if (low !== null && high !== null) return Math.min(value - low, high - value) / (high - low);
  return (low !== null && value <= low) || (high !== null && value >= high) ? 0 : 1;
}

function interlocks(contacts) {
  const items = Object.keys(contacts).map((name) => {
    const says = make("b");
    return [name, make("li", {}, `${LABELS[name.replace("interlock.", "")] ?? name}: `, says), says];
  });
  const first = make("p", { class: "first" });
  const { button, text } = help(...Object.keys(contacts).map((name) => name.replace("interlock.", "")));
  return {
    element: make("section", { class: "card", "aria-label": "interlocks" }, make("h2", {}, "Interlocks", button), text, make("ul", { class: "locks" }, ...items.map(([, item]) => item)), first),
    tell(rig) {
      const broken = rig.state.startsWith("FAULT") || rig.state === "ESTOP";
      for (const [name, item, says] of items) {
        const [on, known] = [rig.contacts[name], name in rig.contacts];
        const short = name.replace("interlock.", "");
        const open = ALARMS.includes(short) && on;
        const rests = open && rig.at_rest && !broken && AT_REST.includes(short);
        says.textContent = known ? CONTACTS[short][Number(on)] + (rests ? " at rest" : "") : "no data";
        item.className = !known || rests ? "" : open ? "alarm" : name === "interlock.command" ? (on ? "fine" : "") : name === "interlock.staged" ? "" : "fine";
      }
      first.textContent = rig.first_out ? `First trip: ${rig.first_out}` : "";
    },
  };
}

function options(rows, chosen) {
  return rows.map(([value, text]) => make("option", { value, selected: value === chosen }, text));
}

function chart(bar, what) {
  const canvas = make("div", { class: "canvas" });
  const legend = make("span", { class: "legend" });
  let plot = null;
  const begin = () => {
    plot?.close();
    const signals = what.signals();
    legend.replaceChildren(...(what.legend ? signals.map((one, k) => make("span", {}, make("i", { style: `background:var(--s${(k % 6) + 1})` }), short(one, signals))) : []));
    plot = what.plot(canvas, signals);
  };
  bar.forEach((one) => one.addEventListener("change", begin));
  return { element: make("div", { class: "card" }, make("div", { class: "bar" }, ...bar, legend), canvas), begin, close: () => plot?.close() };
}

/** The label of one of several signals without the words that all of them share. */
function short(one, all) {
  const words = one.label.split(" ").filter((word) => !all.every((other) => other.label.split(" ").includes(word)));
  return words.join(" ") || one.label;
}

function timeChart(panel, title, span) {
  const panels = [...new Set(panel.about.signals.map((one) => one.panel))];
  const what = make("select", { "aria-label": "what is plotted" }, ...options(panels.map((one) => [one, one]), title));
  const long = make("select", { "aria-label": "how long" }, ...options(SPANS, span));
  return chart([what, long], {
    legend: true,
    signals: () => panel.about.signals.filter((one) => one.panel === what.value),
    plot: (canvas, chosen) => new OverTime(canvas, panel.link, chosen, Number(long.value)),
  });
}

function loopChart(panel, signals) {
  const what = make("select", { "aria-label": "which loop" }, ...options(LOOPS.map((one, k) => [String(k), one[2]]), "0"));
  const long = make("select", { "aria-label": "how long" }, ...options([[2, "2 s"], [5, "5 s"], [10, "10 s"], [20, "20 s"]], 10));
  return chart([what, long], {
    signals: () => LOOPS[Number(what.value)].slice(0, 2).map((name) => signals.get(name)),
    plot: (canvas, pair) => new OverSignal(canvas, panel.link, pair, Number(long.value)),
  });
}
