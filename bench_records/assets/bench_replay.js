/** A kept run in the drawing of the bench: a slider over its time, its events to go to, and play. */
window.benchReplay = (place, told, numbers, moved = () => {}) => {
  const make = (tag, attributes, ...children) => {
    const element = Object.assign(document.createElement(tag), attributes);
    if (attributes.label) element.setAttribute("aria-label", attributes.label);
    element.append(...children);
    return element;
  };
  const choice = (label, rows) => make("select", { label }, ...rows.map(([value, text]) => make("option", { value }, text)));
  const columns = told.signals.map((one) => [one.name, one.at && numbers(one.at)]);
  const never = Object.fromEntries(columns.filter(([, values]) => !values).map(([name]) => [name, "not in the record"]));
  const last = Math.max(0, Math.floor(told.duration / told.step + 1e-6));
  const upTo = (rows, time) => rows.filter(([when]) => when <= time + 1e-6);

  const slider = make("input", { type: "range", min: 0, max: last, step: 1, value: 0, label: "instant of the run" });
  const play = make("button", { type: "button" }, "Play");
  const pace = choice("how fast it plays", [1, 4, 16].map((times) => [times, `× ${times}`]));
  const large = choice("how much the motion is magnified", [1, 3, 10].map((times) => [times, times > 1 ? `motion × ${times}` : "true motion"]));
  const events = choice("go to an event", [["", "go to an event"], ...told.events.map(([when, text]) => [when, `${when.toFixed(1)} s  ${text}`])]);
  const said = make("output", {});
  place.replaceChildren(make("div", { className: "replay-bar" }, play, pace, slider), make("div", { className: "replay-bar" }, said, events, large));
  const drawing = new window.benchDrawing.Drawing(place, told);
  let playing = null; // [when it began (ms), from which instant (s)]

  function show(time) {
    const k = Math.min(last, Math.max(0, Math.round(time / told.step)));
    const now = k * told.step;
    const [values, lacking] = [{}, { ...never }];
    for (const [name, column] of columns) {
      if (!column) continue;
      if (column[k] === null || column[k] === undefined) lacking[name] = "nothing has come";
      else values[name] = column[k];
    }
    const settings = Object.assign({}, ...upTo(told.settings, now).map(([, some]) => some));
    drawing.times = Number(large.value);
    drawing.show({ values, lacking, settings, first: upTo(told.trips, now)[0]?.[1] ?? "" });
    slider.value = k;
    slider.setAttribute("aria-valuetext", `${now.toFixed(1)} s`);
    said.textContent = [`${now.toFixed(1)} s`, upTo(told.states, now).at(-1)?.[1], upTo(told.phases, now).at(-1)?.[1]].filter(Boolean).join(" · ");
    place.dataset.time = now.toFixed(3);
    moved(now);
  }

  function stop() {
    playing = null;
    play.textContent = "Play";
  }

  function step(at) {
    if (!playing || !place.isConnected) return;
    const now = playing[1] + ((at - playing[0]) / 1000) * Number(pace.value);
    show(now);
    now >= last * told.step ? stop() : requestAnimationFrame(step);
  }

  const go = (time) => {
    stop();
    show(time);
  };
  play.addEventListener("click", () => {
    if (playing) return stop();
    playing = [performance.now(), slider.value >= last ? 0 : slider.value * told.step];
    play.textContent = "Pause";
    requestAnimationFrame(step);
  });
  pace.addEventListener("change", () => playing && (playing = [performance.now(), slider.value * told.step]));
  slider.addEventListener("input", () => go(slider.value * told.step));
  large.addEventListener("change", () => show(slider.value * told.step));
  events.addEventListener("change", () => {
    if (events.value !== "") go(Number(events.value));
    events.value = "";
  });
  show(mostKnown() * told.step);
  return { go };

  /** The first instant at which as many readings are known as ever: at 0 s not all of them have come. */
  function mostKnown() {
    const series = columns.map(([, values]) => values).filter(Boolean);
    const known = (k) => series.filter((values) => Number.isFinite(values[k])).length;
    let best = 0;
    for (let k = 1, most = known(0); k <= last && most < series.length; k++) if (known(k) > most) [best, most] = [k, known(k)];
    return best;
  }
};
