/** The bench as a drawing: built once from the rig's dimensions; afterwards nothing but attributes and texts change. */
window.benchDrawing = (() => {
  "use strict";
  // Told by the browser: a report holds no address that anything could be fetched from.
  const SVG = Object.assign(document.createElement("template"), { innerHTML: "<svg></svg>" }).content.firstChild.namespaceURI;
  const SIDES = [["left", -1], ["right", 1]]; // seen from behind: the left is on the left
  const WIDE = 1200; // of the drawing, in its own points
  const NEAR = 0.04; // of the way between two limits
  const FLOWS = 0.03; // bar between two chambers, from which air is drawn as flowing
  const MODES = { hold: "shut", level: "levels", fill: "fills", vent: "vents" };

  /** Where everything stands at rest, in m: x to the right, y up from the platform's upper side. What is not known is drawn as usual. */
  function layout(known = {}) {
    const or = (name, usual) => (Number.isFinite(known[name]) ? known[name] : usual);
    const spacing = or("spring_half_spacing", 1);
    const spring = Math.min(0.5, Math.max(0.12, or("column_height", 0.2)));
    const centre = or("centre_height", 0.25);
    const thick = Math.min(0.6, Math.max(0.36, 2 * centre));
    const left = (name) => or(`${name} across`, name.includes("left") ? spacing : -spacing);
    const push = spring + centre + or("lateral_actuator_height", 0.35);
    const outermost = Math.max(0, ...[1, 2, 3, 4, 5, 6, 7, 8].map((n) => Math.abs(or(`load_cell.${n} across`, 0))));
    const half = Math.max(spacing, outermost - 0.08, ...["vertical_left", "vertical_right"].map((one) => Math.abs(left(one))));
    const top = Math.max(spring + thick, push) + 0.45;
    const [bellows, floor, low] = [Math.min(0.3, 0.6 * spacing), -0.26, -0.98];
    const scale = WIDE / (2 * (half + 1));
    return {
      spacing, spring, centre, thick, push, half, top, bellows, floor, low, scale, height: (top - low) * scale,
      lasers: [left("left.height"), left("right.height")],
      presses: [left("vertical_left"), left("vertical_right")],
      arm: push - spring - centre,
      most: [or("vertical_force_max", 1.8e5), or("lateral_force_max", 2.5e4)],
      cells: [1, 2, 3, 4, 5, 6, 7, 8].map((n) => ({ name: `load_cell.${n}`, ahead: known[`load_cell.${n} ahead`], across: known[`load_cell.${n} across`], up: known[`load_cell.${n} pushes up`] })),
      assumed: ["spring_half_spacing", "column_height", "centre_height"].filter((one) => !Number.isFinite(known[one])),
    };
  }

  /**
   * How bolster and platform stand, from readings in SI (null: not known): where their middles are and how they roll, in m and rad,
   * all motion `times` as large. `seen` says what the bolster's pose was taken from.
   */
  function pose(at, told, times = 1) {
    const given = (name) => (Number.isFinite(told[name]) ? told[name] : null);
    const or = (name) => given(name) ?? 0;
    const ground = { up: or("platform.vertical"), left: or("platform.lateral"), roll: or("platform.roll") };
    const pair = (names, places, less) => {
      const known = names.map((name, k) => [given(name), places[k]]).filter(([value]) => value !== null);
      if (!known.length) return null;
      const roll = known.length === 2 && places[0] !== places[1] ? (known[0][0] - known[1][0]) / (places[0] - places[1]) : less;
      return { up: known[0][0] - roll * known[0][1], roll };
    };
    const heights = pair(["left.height", "right.height"], at.lasers, 0);
    const pistons = heights ? null : pair(["vertical_left.displacement", "vertical_right.displacement"], at.presses, ground.roll);
    const rel = heights ?? (pistons ? { up: pistons.up - ground.up, roll: pistons.roll - ground.roll } : { up: 0, roll: 0 });
    // Springs are drawn no flatter and no longer than pieces have room; the factor of all of it is then less.
    const swing = Math.max(1e-12, ...[1, -1].map((side) => Math.abs(rel.up + side * (at.spacing + at.bellows) * rel.roll)));
    const roll = rel.roll + ground.roll;
    const edge = at.half + 0.36;
    const ways = [or("lateral.displacement"), ground.up, ground.left, edge * ground.roll, 0.8 * (Math.abs(ground.up + rel.up) + edge * Math.abs(roll))];
    const way = Math.max(1e-12, ...ways.map(Math.abs));
    // What a broken sensor reads no spring can do: it is drawn as flat, as tilted or as far off as there is room at all.
    const room = Math.min(times, Math.max(1, (0.6 * at.spring) / swing), Math.max(1, 0.12 / way), (0.8 * at.spring) / swing, 0.16 / way);
    const left = given("lateral.displacement") === null ? ground.left : or("lateral.displacement") + at.arm * roll;
    const body = (one, height) => ({ x: -one.left * room, y: height + one.up * room, roll: one.roll * room });
    return {
      times: room,
      seen: heights ? "heights" : pistons ? "pistons" : "nothing",
      platform: body(ground, 0),
      bolster: body({ up: rel.up + ground.up, left, roll }, at.spring + at.centre),
    };
  }

  /** Where a point of a body stands: `x` to the right of its middle, `y` above it. A roll lifts the left. */
  function point(body, x, y) {
    const [c, s] = [Math.cos(body.roll), Math.sin(body.roll)];
    return [body.x + c * x + s * y, body.y - s * x + c * y];
  }

  /** The four corners of a spring: below on the platform, above on the bolster, outer and inner by the way to the right. */
  function corners(at, { platform, bolster }, way) {
    const middle = way * at.spacing;
    return [
      ...[-1, 1].map((k) => point(platform, middle + k * at.bellows, 0)),
      ...[1, -1].map((k) => point(bolster, middle + k * at.bellows, -at.centre)),
    ];
  }

  function fixed(value, decimals) {
    if (!Number.isFinite(value)) return "–";
    const text = Math.abs(value).toFixed(decimals);
    return (value < 0 && Number(text) ? "\u2212" : "") + text;
  }

  /** Places (m) near those of `wanted`, no two of them closer than `least`. */
  function apart(wanted, least) {
    const order = wanted.map((_, k) => k).sort((a, b) => wanted[a] - wanted[b]);
    const found = [...wanted];
    for (let round = 0; round < 60; round++)
      order.slice(1).forEach((next, k) => {
        const lacks = (least - (found[next] - found[order[k]])) / 2;
        if (lacks > 0) [found[next], found[order[k]]] = [found[next] + lacks, found[order[k]] - lacks];
      });
    return found;
  }

  /** "over", "near" or "": how a value stands to the limits of its signal. */
  function standing({ low, high }, value) {
    if (!Number.isFinite(value)) return "";
    const [least, most] = [low ?? -Infinity, high ?? Infinity];
    if (value <= least || value >= most) return "over";
    return Math.min(value - least, most - value) / (most - least) < NEAR ? "near" : "";
  }

  function make(parent, tag, attributes = {}, text = "") {
    const element = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    if (text) element.textContent = text;
    parent.append(element);
    return element;
  }

  /** Changes an attribute or a text only where it is another one: a picture costs what moves. */
  function set(element, name, value) {
    const known = (element.was ??= {});
    if (known[name] === value) return;
    known[name] = value;
    name === "text" ? (element.textContent = value) : element.setAttribute(name, value);
  }

  /** The parts of a text: a number that changes, its unit, and what it is `of`, both smaller. */
  function number(text, unit, of = "") {
    const [digits, small] = [make(text, "tspan"), make(text, "tspan", { class: "unit" })];
    if (of) make(text, "tspan", { class: "unit of" }, ` ${of}`);
    return { text, digits, small, unit: ` ${unit}` };
  }

  /** Writes a number, with its unit or without. */
  function tell({ digits, small, unit }, text, known) {
    set(digits, "text", text);
    set(small, "text", known ? unit : "");
  }

  class Drawing {
    /** `signals` have name, label, unit, decimals, factor (SI of one unit), low and high. */
    constructor(place, { dimensions, signals }) {
      this.at = layout(dimensions);
      this.signals = new Map(signals.map((one) => [one.name, one]));
      this.times = 1;
      this.labels = new Map();
      this.svg = make(place, "svg", { class: "bench", viewBox: `0 0 ${WIDE} ${Math.ceil(this.at.height)}`, role: "img", "aria-label": "The bench" });
      this.build();
    }

    px(x) { return WIDE / 2 + x * this.at.scale; }
    py(y) { return (this.at.top - y) * this.at.scale; }
    round(points) { return points.map(([x, y]) => `${this.px(x).toFixed(1)} ${this.py(y).toFixed(1)}`); }
    box(parent, x, y, w, h, look) {
      return make(parent, "rect", { x: this.px(x), y: this.py(y + h), width: w * this.at.scale, height: h * this.at.scale, rx: 5, ...look });
    }

    build() {
      const { at, svg } = this;
      const half = at.half + 0.36;
      this.box(svg, -half, at.top - 0.07, 2 * half, 0.07, { class: "frame" });
      this.box(svg, -half, at.floor - 0.2, 2 * half, 0.05, { class: "frame" });
      this.pipe = make(svg, "path", { class: "pipe", d: `M${this.px(-half - 0.3)} ${this.py(at.floor - 0.46)}H${this.px(half + 0.3)}` });
      this.cells(svg);
      this.platform = make(svg, "g");
      this.box(this.platform, -half, at.floor, 2 * half, -at.floor, { class: "steel" });
      this.bolster = make(svg, "g");
      this.box(this.bolster, -half, at.spring, 2 * half, at.thick, { class: "steel" });
      if (at.push > at.spring + at.thick) this.box(this.bolster, half - 0.12, at.spring + at.thick - 0.02, 0.12, at.push - at.spring - at.thick + 0.07, { class: "steel" });
      this.sides = SIDES.map(([side, way], k) => this.side(side, way, k));
      this.bridge(svg);
      this.lateral(svg, half);
      const middle = at.spring + at.thick / 2;
      const row = (points) => middle + points / at.scale;
      this.label("lateral.displacement", 0, row(21), "lateral", { beside: true });
      this.roll = number(make(svg, "text", { class: "value minor", x: this.px(0), y: this.py(row(-15)) }), "mrad", "roll");
      this.label("lateral.acceleration", 0, row(-46), "", { look: "minor small" });
      this.label("supply.pressure", -half - 0.1, at.floor - 0.59, "supply");
      ["vertical", "lateral", "roll"].forEach((one, k) => this.label(`platform.${one}`, (190 / at.scale) * (k - 0.7), at.floor - 0.59, `platform ${["up", "left", "roll"][k]}`, { look: "minor small" }));
    }

    side(side, way, k) {
      const { at, svg } = this;
      const [x, out] = [way * at.spacing, way * (at.half + 0.66)];
      const spring = make(svg, "path", { class: "air", "data-part": `${side} spring` });
      const chamber = this.box(this.platform, x - 0.42, at.floor + 0.05, 0.84, 0.17, { class: "air" });
      const orifice = make(svg, "path", { class: "flow" });
      const laser = make(svg, "path", { class: "laser" });
      const feed = make(svg, "path", { class: "pipe", d: `M${this.px(way * (at.half + 0.36))} ${this.py(at.spring / 2)}H${this.px(out)}V${this.py(at.floor - 0.46)}` });
      const flow = make(svg, "path", { class: "flow", d: feed.getAttribute("d") });
      const valve = make(svg, "path", { class: "valve", d: bowtie(this.px(out), this.py(at.floor / 2)) });
      this.label(`${side}.height`, x, at.spring + at.thick / 2 + 0.02, `${side} height`);
      this.label(`${side}.bellows_pressure`, x, at.spring / 2 - 0.045, "", { look: "inside" });
      this.label(`${side}.auxiliary_pressure`, x, at.floor + 0.09, "");
      this.label(`${side}.bellows_temperature`, out + way * 0.03, at.spring + 0.33, "bellows", { look: "minor small", called: "temperature" });
      this.label(`${side}.auxiliary_temperature`, out + way * 0.03, at.spring + 0.13, "chamber", { look: "minor small", called: "temperature" });
      const mode = make(svg, "text", { class: "name", x: this.px(out + way * 0.04), y: this.py(at.spring / 2 + 0.05) });
      const press = -at.presses[k];
      this.box(svg, press - 0.09, at.top - 0.3, 0.18, 0.24, { class: "cylinder" });
      const rod = make(svg, "path", { class: "rod" });
      const force = make(svg, "path", { class: "force" });
      this.label(`vertical_${side}.force`, press - way * 0.13, at.top - 0.2, `vertical ${side}`, { toward: -way });
      return { side, way, spring, chamber, orifice, laser, flow, valve, mode, press, rod, force };
    }

    bridge(svg) {
      const { at } = this;
      const y = at.floor + 0.165;
      make(this.platform, "path", { class: "pipe", d: `M${this.px(0.42 - at.spacing)} ${this.py(y)}H${this.px(at.spacing - 0.42)}` });
      this.dpv = make(this.platform, "path", { class: "valve", d: bowtie(this.px(0), this.py(y)) });
      this.between = make(svg, "text", { class: "name minor", x: this.px(0), y: this.py(at.floor + 0.035) });
    }

    lateral(svg, half) {
      const { at } = this;
      this.box(svg, half + 0.3, at.push - 0.07, 0.3, 0.14, { class: "cylinder" });
      this.side_rod = make(svg, "path", { class: "rod" });
      this.side_force = make(svg, "path", { class: "force" });
      this.end = half;
      this.label("lateral.force", half + 0.62, at.push + 0.2, "lateral", { toward: -1 });
    }

    cells(svg) {
      const { at } = this;
      const known = at.cells.filter(({ name }) => this.signals.has(name));
      const places = known.map((cell, k) => {
        const usual = [1, -1, 1, -1, 0, 0, 0, 0][k] * at.spacing;
        const upright = Math.abs(cell.up ?? (k < 4 ? 1 : 0)) > 0.5;
        const ahead = (cell.ahead ?? [1, 1, -1, -1, 1, -1, 1, -1][k]) >= 0;
        return -(cell.across ?? usual) + (upright ? 0.22 : 0.25) * (ahead ? -1 : 1);
      });
      const words = apart(places, 140 / at.scale);
      known.forEach(({ name }, k) => {
        this.box(svg, places[k] - 0.05, at.floor - 0.15, 0.1, 0.15, { class: "cell" });
        this.label(name, words[k], at.floor - 0.31, name.replace("load_cell.", "cell "), { look: "minor small" });
      });
    }

    /**
     * A reading at its place: the value with its unit, and its name below or `beside` it. It stands in the middle of
     * (x, y), or goes from there `toward` the right (1) or the left (-1). What it is `called` stands there crossed out
     * where there is none.
     */
    label(name, x, y, title, { look = "", beside = false, toward = 0, called = title || name.replace(/.*[._]/, "") } = {}) {
      const signal = this.signals.get(name);
      if (!signal) return;
      const group = make(this.svg, "g", { class: "label", "data-signal": name });
      const hint = make(group, "title");
      const [px, py] = [this.px(x), this.py(y)];
      const text = { x: px, "text-anchor": ["end", "middle", "start"][toward + 1] };
      const value = make(group, "text", { class: `value ${look}`, y: py, ...text });
      if (title && !beside) make(group, "text", { class: `name ${look}${called === title ? " twice" : ""}`, y: py + (look.includes("small") ? 21 : 26), ...text }, title);
      const shown = number(value, signal.unit, beside ? title : "");
      this.labels.set(name, { signal, group, value, shown, hint, look, called });
    }

    /** Show readings (`values` in the units of the signals), what is `lacking` and why, `settings` in force, what tripped `first`. */
    show({ values = {}, lacking = {}, settings = {}, first = "" }) {
      const si = {};
      this.told = [];
      for (const [name, one] of this.labels) {
        const { signal, group, shown, hint, look, called } = one;
        const why = lacking[name] ?? (Number.isFinite(values[name]) ? "" : "nothing has come");
        const number = why ? NaN : values[name];
        const stands = standing(signal, number);
        const now = ["label", why ? "lacking" : stands, name === first ? "first" : ""].filter(Boolean).join(" ");
        set(group, "class", look.includes("minor") ? `${now} minor` : now);
        tell(shown, why ? called : fixed(number, signal.decimals), !why);
        set(hint, "text", why ? `${signal.label}: ${why}` : signal.label);
        one.stands = stands;
        if (why) this.told.push(`${signal.label} is not known: ${why}`);
        else if (stands === "over") this.told.push(`${signal.label} ${fixed(number, signal.decimals)} ${signal.unit} is beyond a limit`);
      }
      for (const [name, { factor }] of this.signals) si[name] = lacking[name] || !Number.isFinite(values[name]) ? null : values[name] * factor;
      this.move(pose(this.at, si, this.times));
      this.sides.forEach((one) => this.air(one, values, lacking, settings, si));
      set(this.dpv, "class", `valve ${{ on: "ready", off: "shut" }[settings["air.dpv"]] ?? "unknown"}`);
      const apart = SIDES.map(([side]) => (lacking[`${side}.auxiliary_pressure`] ? NaN : values[`${side}.auxiliary_pressure`]));
      set(this.between, "text", `Δ ${fixed(apart[0] - apart[1], 2)} bar`);
      this.describe(values, settings, si);
    }

    move(now) {
      const { at } = this;
      this.now = now;
      const place = (group, body, y) => {
        const turn = (body.roll * 180) / Math.PI;
        set(group, "transform", `translate(${(body.x * at.scale).toFixed(1)} ${((y - body.y) * at.scale).toFixed(1)}) rotate(${turn.toFixed(3)} ${this.px(0)} ${this.py(y).toFixed(1)})`);
      };
      place(this.platform, now.platform, 0);
      place(this.bolster, now.bolster, at.spring + at.centre);
      set(this.bolster, "class", now.seen === "nothing" ? "unknown" : "");
      const ride = (group, up, right = 0) => group && set(group, "transform", `translate(${(right * at.scale).toFixed(1)} ${(-up * at.scale).toFixed(1)})`);
      const along = (group, x) => ride(group, point(now.bolster, x, 0)[1] - at.spring - at.centre, now.bolster.x);
      for (const name of ["lateral.displacement", "lateral.acceleration"]) along(this.labels.get(name)?.group, 0);
      along(this.roll.text, 0);
      this.sides.forEach(({ side, way, spring, orifice, laser, press, rod }, k) => {
        const four = corners(at, now, way);
        along(this.labels.get(`${side}.height`)?.group, way * at.spacing);
        ride(this.labels.get(`${side}.auxiliary_pressure`)?.group, point(now.platform, way * at.spacing, 0)[1], now.platform.x);
        ride(this.labels.get(`${side}.bellows_pressure`)?.group, (four[0][1] + four[1][1] + four[2][1] + four[3][1]) / 4 - at.spring / 2, (now.bolster.x + now.platform.x) / 2);
        const [a, b, c, d] = this.round(four);
        const bulge = (p, q, w) => this.round([[(p[0] + q[0]) / 2 + w * 0.09, (p[1] + q[1]) / 2]])[0];
        set(spring, "d", `M${a}L${b}Q${bulge(four[1], four[2], 1)} ${c}L${d}Q${bulge(four[3], four[0], -1)} ${a}Z`);
        set(orifice, "d", `M${this.round([point(now.platform, way * at.spacing, at.floor + 0.22), point(now.platform, way * at.spacing, 0.03)]).join("L")}`);
        const x = -at.lasers[k] + (Math.abs(at.lasers[k]) > at.spacing - at.bellows - 0.1 ? way * (at.bellows + 0.12) : 0);
        set(laser, "d", `M${this.round([point(now.platform, x, 0), point(now.bolster, x, -at.centre)]).join("L")}`);
        set(rod, "d", `M${this.round([[press, at.top - 0.3], point(now.bolster, press, at.thick - at.centre)]).join("L")}`);
      });
      set(this.side_rod, "d", `M${this.round([[this.end + 0.3, at.push], point(now.bolster, this.end, at.arm)]).join("L")}`);
    }

    air({ side, way, spring, chamber, orifice, flow, valve, mode, press, force }, values, lacking, settings, si) {
      const pressed = si[`vertical_${side}.force`];
      const long = reach(pressed, this.at.most[0], 0.2);
      const y = this.at.top - 0.19;
      set(force, "d", arrow(this.px(press), this.py(y + long / 2), 0, long * this.at.scale));
      if (side === "left") {
        const sideways = si["lateral.force"];
        const long = reach(sideways, this.at.most[1], 0.24);
        set(this.side_force, "d", arrow(this.px(this.end + 0.45 + long / 2), this.py(this.at.push), -long * this.at.scale, 0));
      }
      const over = (...names) => names.some((one) => this.labels.get(`${side}.${one}`)?.stands === "over");
      set(spring, "class", `air${over("height", "bellows_pressure") ? " over" : ""}`);
      set(chamber, "class", `air${over("auxiliary_pressure") ? " over" : ""}`);
      const does = settings[`air.${side}_mode`];
      set(mode, "text", MODES[does] ?? (does === undefined ? "" : "?"));
      const aim = { fill: -1, vent: 1, level: levels(si[`${side}.height`]) }[does] ?? 0;
      set(valve, "class", `valve ${does === "hold" ? "shut" : aim ? "open" : does in MODES ? "ready" : "unknown"}`);
      this.drift(flow, aim);
      const [p, q] = ["bellows", "auxiliary"].map((one) => (lacking[`${side}.${one}_pressure`] ? NaN : values[`${side}.${one}_pressure`]));
      const joined = settings[`air.${side}_reservoir`] !== "off";
      this.drift(orifice, joined && Math.abs(p - q) > FLOWS ? Math.sign(q - p) : 0);
      set(orifice, "data-joined", String(joined));
    }

    /** Lets the dashes of a line wander: along it (1), back (-1), or none is seen. */
    drift(path, way) {
      path.walked = ((path.walked ?? 0) - 3 * way + 24) % 24;
      set(path, "class", way ? "flow on" : "flow");
      set(path, "stroke-dashoffset", way ? path.walked : 0);
    }

    describe(values, settings, si) {
      const { now, at } = this;
      const heights = si["left.height"] !== null && si["right.height"] !== null;
      const roll = heights ? ((si["left.height"] - si["right.height"]) / (at.lasers[0] - at.lasers[1])) * 1e3 : NaN;
      tell(this.roll, fixed(roll, 1), Number.isFinite(roll));
      const of = (name) => (Number.isFinite(si[name]) ? `${fixed(values[name], this.signals.get(name).decimals)} ${this.signals.get(name).unit}` : "not known");
      const sides = SIDES.map(([side]) => `${side} spring: height ${of(`${side}.height`)}, ${of(`${side}.bellows_pressure`)}, pressed with ${of(`vertical_${side}.force`)}, valve ${MODES[settings[`air.${side}_mode`]] ?? "not known"}`);
      this.alternative = ["The bench from behind", ...sides, `lateral ${of("lateral.displacement")}, ${of("lateral.force")}`, `supply ${of("supply.pressure")}`, now.seen === "nothing" ? "where the bolster stands is not known" : "", ...this.told].filter(Boolean).join("; ") + ".";
      const second = Math.floor(performance.now() / 1000);
      if (second !== this.second) set(this.svg, "aria-label", this.alternative);
      this.second = second;
    }
  }

  /** A leveling valve fills below its height and lets off above it; between, its dead zone, nothing flows. */
  const levels = (height) => (height === null || Math.abs(height) < 0.005 ? 0 : height < 0 ? -1 : 1);
  /** How long the arrow of a force is, of `longest` m at the greatest force; a hundredth of that has none. */
  const reach = (force, most, longest) => (Math.abs(force ?? 0) < most / 100 ? 0 : Math.sign(force) * longest * Math.min(1, 0.2 + (0.8 * Math.abs(force)) / most));
  const bowtie = (x, y) => `M${x - 16} ${y - 13}V${y + 13}L${x + 16} ${y - 13}V${y + 13}Z`;

  /** An arrow from (x, y) by (dx, dy), down and to the right in points of the drawing. */
  function arrow(x, y, dx, dy) {
    const long = Math.hypot(dx, dy);
    if (long < 2) return "M0 0";
    const [u, v] = [dx / long, dy / long];
    const [tx, ty] = [x + dx, y + dy];
    const wing = (s) => `${(tx - 14 * u + s * 9 * v).toFixed(1)} ${(ty - 14 * v - s * 9 * u).toFixed(1)}`;
    return `M${x.toFixed(1)} ${y.toFixed(1)}L${tx.toFixed(1)} ${ty.toFixed(1)}M${wing(1)}L${tx.toFixed(1)} ${ty.toFixed(1)}L${wing(-1)}`;
  }

  return { layout, pose, point, corners, standing, Drawing };
})();
