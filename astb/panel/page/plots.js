/** Live plots: signals over time, and one signal over another. */

import { ticks } from "/page/format.js";

const FRAME = 1000 / 30; // ms; a screen needs no more
const STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 900, 1800]; // s between two marks of time
const BRIDGED = 0.35; // s: a gap up to this long is only a slow signal
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const series = (k) => `--s${(k % 6) + 1}`;

/** The last stretches of a trace, in memory of one size. */
class Kept {
  constructor(signals, span) {
    Object.assign(this, { signals, span, width: 0, head: -1 });
  }

  take(first, width, fresh, low, high) {
    if (fresh || width !== this.width) {
      this.width = width;
      this.size = Math.ceil(this.span / width) + 2;
      this.low = this.signals.map(() => new Float32Array(this.size).fill(NaN));
      this.high = this.signals.map(() => new Float32Array(this.size).fill(NaN));
      this.head = -1;
    }
    const count = low[0].length;
    for (let at = Math.max(this.head + 1, first - this.size); this.head >= 0 && at < first; at++) {
      for (const values of [...this.low, ...this.high]) values[at % this.size] = NaN; // pictures that were lost
    }
    for (let k = Math.max(0, count - this.size); k < count; k++) {
      this.signals.forEach((_, row) => {
        this.low[row][(first + k) % this.size] = low[row][k];
        this.high[row][(first + k) % this.size] = high[row][k];
      });
    }
    this.head = Math.max(this.head, first + count - 1);
  }
}

/** What every plot does: it has the size of its place and the colours of its scheme, as long as it is open. */
class Drawn {
  begin(element, options, data) {
    this.plot = new uPlot(options, data, element);
    this.observer = new ResizeObserver(() => this.plot.setSize(size(element)));
    this.observer.observe(element);
    this.scheme = matchMedia("(prefers-color-scheme: dark)");
    this.repaint = () => this.plot.redraw(false, true);
    this.scheme.addEventListener("change", this.repaint);
  }

  close() {
    this.observer.disconnect();
    this.scheme.removeEventListener("change", this.repaint);
    this.plot.destroy();
  }
}

class Plot extends Drawn {
  constructor(element, link, signals, span, columns) {
    super();
    Object.assign(this, { element, link, signals, drawn: 0, due: false });
    this.kept = new Kept(signals, span);
    this.begin(element, this.options(signals, span), this.data());
    this.leave = link.trace(signals.map((one) => one.name), span, columns, (...picture) => {
      this.kept.take(...picture);
      this.redraw();
    });
  }

  redraw() {
    if (this.due) return;
    this.due = true;
    requestAnimationFrame((now) => {
      this.due = false;
      if (now - this.drawn < FRAME) return this.redraw();
      this.drawn = now;
      this.plot.setData(this.data());
      Plot.pictures += 1;
    });
  }

  close() {
    this.leave();
    super.close();
  }
}
Plot.pictures = 0;
window.astbPictures = () => Plot.pictures;

/** Signals of one unit over the last `span` s. */
export class OverTime extends Plot {
  constructor(element, link, signals, span) {
    super(element, link, signals, span, Math.min(1200, Math.max(300, Math.round(size(element).width))));
  }

  data() {
    const { head, size: most, width, low, high } = this.kept ?? {};
    if (!width || head < 0) return [[0], ...this.signals.map(() => [null])];
    const first = Math.max(0, head - most + 1);
    const xs = [];
    const ys = this.signals.map(() => []);
    for (let at = first; at <= head; at++) {
      // Lows and highs one after the other: the line fills what lies between.
      xs.push((at - head) * width, (at - head) * width);
      const k = at % most;
      ys.forEach((values, row) => {
        const [a, b] = [low[row][k], high[row][k]];
        const gone = Number.isNaN(a);
        values.push(gone ? null : a, gone ? null : b);
      });
    }
    return [xs, ...ys];
  }

  options(signals, span) {
    const unit = signals[0].unit;
    return {
      ...common(this.element),
      scales: { x: { time: false, range: [-span, 0] }, y: { range: (_, low, high) => roomy(low, high, signals[0]) } },
      axes: [{ ...(span > 120 ? axis("min", 60) : axis("s")), incrs: STEPS, size: 28 }, { ...axis(), size: 46, label: unit, labelSize: 16, labelFont: "12px sans-serif" }],
      series: [
        {},
        ...signals.map((one, k) => ({
          label: one.label,
          stroke: () => colour(series(k)),
          width: 1.5,
          points: { show: false },
          gaps: (plot, _, from, to, gaps) => gaps.filter(([a, b]) => plot.posToVal(b, "x", true) - plot.posToVal(a, "x", true) > BRIDGED),
        })),
      ],
    };
  }
}

/** The second signal over the first one, the last `span` s; older is fainter. */
export class OverSignal extends Plot {
  constructor(element, link, signals, span) {
    super(element, link, signals, span, 4000);
  }

  data() {
    const { head, size: most, width, low, high } = this.kept ?? {};
    const [xs, ys] = [[], []];
    if (width && head >= 0) {
      for (let at = Math.max(0, head - most + 1); at <= head; at++) {
        const k = at % most;
        const [x, y] = [(low[0][k] + high[0][k]) / 2, (low[1][k] + high[1][k]) / 2];
        if (!Number.isNaN(x) && !Number.isNaN(y)) (xs.push(x), ys.push(y));
      }
    }
    return [null, [xs, ys]];
  }

  options(signals) {
    return {
      ...common(this.element),
      mode: 2,
      scales: {
        x: { time: false, range: (_, low, high) => roomy(low, high, signals[0]) },
        y: { range: (_, low, high) => roomy(low, high, signals[1]) },
      },
      axes: signals.map((one) => ({ ...axis(), label: `${one.label.split(" ").slice(-1)[0]}, ${one.unit}`, labelSize: 18, size: 40, labelFont: "12px sans-serif" })),
      series: [null, { facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }], paths: trail, stroke: () => colour("--s1") }],
    };
  }
}

/** A reading over time within the band in which its model expects it. */
export class Banded extends Drawn {
  constructor(element, { label, unit, decimals }) {
    super();
    const edge = { stroke: "transparent", points: { show: false } };
    this.begin(
      element,
      {
        ...common(element),
        scales: { x: { time: false }, y: { range: (_, low, high) => roomy(low, high, { decimals }) } },
        axes: [{ ...axis("s"), size: 26 }, { ...axis(), size: 62 }],
        series: [
          {},
          edge,
          edge,
          { label: `${label}, expected`, stroke: () => colour("--soft"), width: 1, dash: [5, 4], points: { show: false } },
          { label: `${label}, ${unit}`, stroke: () => colour("--s1"), width: 1.8, points: { show: false } },
        ],
        bands: [{ series: [1, 2], fill: () => colour("--band") }],
      },
      [[0], [null], [null], [null], [null]],
    );
  }

  set(times, { measured, expected, band }) {
    const edge = (sign) => expected.map((value, k) => (value === null ? null : value + sign * band[k]));
    this.plot.setData([times, edge(1), edge(-1), expected, measured]);
  }
}

const PARTS = 12;

function trail(plot, index) {
  const [xs, ys] = plot.data[index];
  const { ctx } = plot;
  ctx.save();
  ctx.beginPath();
  ctx.rect(plot.bbox.left, plot.bbox.top, plot.bbox.width, plot.bbox.height);
  ctx.clip();
  ctx.strokeStyle = colour("--s1");
  ctx.lineWidth = 1.6 * devicePixelRatio;
  ctx.lineJoin = "round";
  for (let part = 0; part < PARTS; part++) {
    const [from, to] = [part, part + 1].map((n) => Math.floor(((xs.length - 1) * n) / PARTS));
    ctx.globalAlpha = 0.15 + (0.85 * (part + 1)) / PARTS;
    ctx.beginPath();
    for (let k = from; k <= to && k < xs.length; k++) {
      const [x, y] = [plot.valToPos(xs[k], "x", true), plot.valToPos(ys[k], "y", true)];
      k === from ? ctx.moveTo(x, y) : ctx.lineTo(x, y);
    }
    ctx.stroke();
  }
  ctx.restore();
  return null;
}

const size = (element) => ({ width: Math.max(100, element.clientWidth), height: Math.max(60, element.clientHeight) });

const common = (element) => ({ ...size(element), legend: { show: false }, cursor: { drag: { x: false, y: false } }, padding: [8, 12, 4, 0] });

const axis = (unit = "", factor = 1) => ({
  stroke: () => colour("--soft"),
  font: "12px sans-serif",
  grid: { stroke: () => colour("--hair"), width: 1 },
  ticks: { show: false },
  values: (_, values, index, space, step) =>
    ticks(values.map((value) => (value === null ? null : value / factor)), step / factor).map((text) => (text && unit ? `${text}\u2009${unit}` : text)),
});

/** A range that noise does not fill: at least some forty steps of the last decimal. */
function roomy(low, high, signal) {
  if (low === null || high === null || !Number.isFinite(low) || !Number.isFinite(high)) return [0, 1];
  const least = 40 * 10 ** -signal.decimals;
  const room = Math.max(high - low, least) * 0.08;
  const more = Math.max(0, least - (high - low)) / 2;
  return [low - more - room, high + more + room];
}
