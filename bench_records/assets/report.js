// Plots in the place of a report's pictures: drag to zoom, double click to return, point to read values.
// Where scripts are off, and in print, the pictures stay.
(async () => {
  "use strict";
  if (!window.DecompressionStream || !window.uPlot) return;
  const plots = JSON.parse(document.getElementById("plots").textContent);
  const numbers = await window.unpacked(document.getElementById("plot-data").textContent);

  const shown = (value, range) => {
    if (value == null) return "–";
    const decimals = range > 0 ? Math.min(8, Math.max(0, 4 - Math.ceil(Math.log10(range)))) : 3;
    return value.toFixed(decimals).replace("-", "−");
  };
  const swing = (u, key) => Math.abs(u.scales[key].max - u.scales[key].min);
  const axis = (label, size) => ({
    label, size, labelSize: 16, labelGap: 0, stroke: "#68727c", grid: { stroke: "#dfe3e7", width: 1 }, ticks: { show: false },
    font: "11px sans-serif", labelFont: "11px sans-serif",
    values: (u, ticks) => ticks.map((n) => (n == null ? "" : String(+n.toPrecision(6)).replace("-", "−"))),
  });

  // A loop is no function of its abscissa: its points are joined as they come.
  const joined = (u, index) => {
    const [xs, ys] = u.data[index], { ctx, bbox } = u, ratio = devicePixelRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.beginPath();
    let down = false;
    for (let i = 0; i < xs.length; i++) {
      if (xs[i] == null || ys[i] == null) { down = false; continue; }
      const x = u.valToPos(xs[i], "x", true), y = u.valToPos(ys[i], "y", true);
      down ? ctx.lineTo(x, y) : ctx.moveTo(x, y);
      down = true;
    }
    ctx.strokeStyle = u.series[index].stroke(u, index);
    ctx.lineWidth = 1.2 * ratio;
    ctx.setLineDash((u.series[index].dash || []).map((n) => n * ratio));
    ctx.stroke();
    ctx.restore();
    return null;
  };
  const extent = (plot, key) => () => {
    let low = Infinity, high = -Infinity;
    for (const trace of plot.traces) [low, high] = [Math.min(low, trace[key][2]), Math.max(high, trace[key][3])];
    const room = 0.05 * (high - low || 1);
    return [low - room, high + room];
  };
  const shaded = (plot) => (u) => {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.fillStyle = "#f1f4f6";
    for (const [start, end] of plot.shades) {
      const left = Math.max(u.valToPos(start, "x", true), bbox.left);
      const right = Math.min(u.valToPos(end, "x", true), bbox.left + bbox.width);
      if (right > left) ctx.fillRect(left, bbox.top, right - left, bbox.height);
    }
    ctx.strokeStyle = "#b3261e";
    ctx.setLineDash([6, 4]);
    for (const mark of plot.marks) {
      const x = u.valToPos(mark, "x", true);
      if (x < bbox.left || x > bbox.left + bbox.width) continue;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  };
  // From each point to either side what it may be off by.
  const bars = (plot) => (u) => {
    const { ctx, bbox } = u, ratio = devicePixelRatio, end = 3 * ratio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    for (const [index, trace] of plot.traces.entries()) {
      if (!trace.expanded || !u.series[index + 1].show) continue;
      const [xs, ys, expanded] = [trace.x, trace.y, trace.expanded].map(numbers);
      ctx.strokeStyle = trace.color;
      ctx.lineWidth = ratio;
      ctx.beginPath();
      for (let i = 0; i < xs.length; i++) {
        if (xs[i] == null || ys[i] == null || expanded[i] == null) continue;
        const x = u.valToPos(xs[i], "x", true);
        const [low, high] = [ys[i] - expanded[i], ys[i] + expanded[i]].map((y) => u.valToPos(y, "y", true));
        ctx.moveTo(x, low);
        ctx.lineTo(x, high);
        for (const y of [low, high]) {
          ctx.moveTo(x - end, y);
          ctx.lineTo(x + end, y);
        }
      }
      ctx.stroke();
    }
    ctx.restore();
  };
  // A zigzag on the scale beyond which its zero lies.
  const broken = (u) => {
    const { ctx, bbox } = u, { min, max } = u.scales.y, ratio = devicePixelRatio;
    if (min <= 0 && max >= 0) return;
    ctx.save();
    ctx.translate(bbox.left, min > 0 ? bbox.top + bbox.height - 12 * ratio : bbox.top + 2 * ratio);
    ctx.scale(ratio, ratio);
    ctx.strokeStyle = "#68727c";
    ctx.beginPath();
    [[0, 0], [-4, 2], [4, 4], [-4, 6], [4, 8], [0, 10]].forEach(([x, y]) => ctx.lineTo(x, y));
    ctx.stroke();
    ctx.restore();
  };

  const together = uPlot.sync("time");
  const build = (place, plot) => {
    const loop = plot.kind === "loop", time = plot.kind === "time";
    const series = plot.traces.map((trace) => ({
      label: trace.label, stroke: trace.color, dash: trace.dash, width: trace.width,
      points: plot.kind === "sweep" ? { show: true, size: 4 + 2 * trace.width } : { show: false },
      value: (u, value) => shown(value, swing(u, "y")),
      ...(loop && { paths: joined, facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }] }),
    }));
    const tables = plot.traces.map((trace) => [numbers(trace.x), numbers(trace.y)]);
    const options = {
      mode: loop ? 2 : 1, width: place.clientWidth, height: time ? 180 : 290, title: plot.title,
      series: [loop ? {} : { label: plot.x, value: (u, value) => shown(value, swing(u, "x")) }, ...series],
      scales: {
        x: {
          time: false, distr: plot.logarithmic ? 3 : 1, ...(loop && { range: extent(plot, "x") }),
          ...(plot.logarithmic && { range: (u, low, high) => [low / 1.05, high * 1.05] }),
        },
        y: loop ? { range: extent(plot, "y") } : {},
      },
      axes: [{ ...axis(plot.x, 26), ...(plot.ticks.length && { splits: () => plot.ticks, filter: (u, ticks) => ticks }) }, axis(plot.y, 52)],
      legend: { live: !loop },
      cursor: { drag: { x: true, y: !time, uni: 20 }, ...(time && { sync: { key: together.key } }) },
      hooks: { drawClear: [shaded(plot)], draw: [broken, bars(plot)] },
    };
    if (loop) {
      // Zooming must not be undone by the range of all points.
      const first = { x: options.scales.x.range, y: options.scales.y.range };
      for (const key of ["x", "y"]) options.scales[key].range = (u, low, high) =>
        u && u.zoomed ? [low, high] : first[key]();
      options.hooks.setSelect = [(u) => { u.zoomed = u.select.width > 0 || u.select.height > 0; }];
      options.hooks.setCursor = [(u) => {
        const { left, top } = u.cursor;
        u.where.textContent = left < 0 ? "" :
          `${plot.x} ${shown(u.posToVal(left, "x"), swing(u, "x"))}; ${plot.y} ${shown(u.posToVal(top, "y"), swing(u, "y"))}`;
      }];
      options.hooks.init = [(u) => {
        u.where = document.createElement("div");
        u.where.className = "where";
        u.root.append(u.where);
        u.over.addEventListener("dblclick", () => { u.zoomed = false; }, true);
      }];
    }
    const u = new uPlot(options, loop ? [null, ...tables] : uPlot.join(tables), place);
    new ResizeObserver(() => {
      if (place.clientWidth && place.clientWidth !== u.width) u.setSize({ width: place.clientWidth, height: u.height });
    }).observe(place);
    place.classList.add("live");
    place.plot = u;
  };
  for (const place of document.querySelectorAll(".zoom")) build(place, plots[place.dataset.plot]);
  document.documentElement.dataset.plots = "live";
  const replay = document.getElementById("replay");
  if (replay) {
    const place = document.querySelector(".replay");
    const times = [...document.querySelectorAll(".zoom.live")].filter((one) => plots[one.dataset.plot].kind === "time");
    const point = (now) => times.forEach(({ plot }) => plot.setCursor({ left: plot.valToPos(now, "x"), top: 0 }, false));
    const { go } = window.benchReplay(place, JSON.parse(replay.textContent), numbers, point);
    for (const { plot } of times) plot.over.addEventListener("click", () => plot.cursor.left >= 0 && go(plot.posToVal(plot.cursor.left, "x")));
    const asked = () => {
      const time = /^#t=([\d.]+)$/.exec(location.hash)?.[1];
      if (time === undefined) return;
      go(Number(time));
      place.scrollIntoView();
    };
    addEventListener("hashchange", asked);
    asked();
  }
})();
