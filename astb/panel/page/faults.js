/** The view of faults on purpose: what is on, and what can be broken on a simulated rig. */

import { make } from "/page/format.js";
import { asked, repeated } from "/page/tables.js";

const AGAIN = 1000; // ms

export function show(element, panel) {
  const wrong = make("p", { class: "wrong", role: "alert" });
  const active = make("section", { class: "card", "aria-label": "faults that are on" });
  const groups = make("div", { class: "faults" });
  element.append(make("div", { class: "view" }, wrong, active, groups));
  let drawn = false;
  let buttons = [];
  const rest = repeated(load, AGAIN);
  const leave = panel.link.listen(allow);
  return () => {
    rest();
    leave();
  };

  async function load() {
    const { found, error } = await asked("/api/faults");
    if (error) {
      delete active.dataset.key;
      return void active.replaceChildren(make("p", { class: "said" }, error));
    }
    if (!drawn) {
      drawn = true;
      const places = [...new Set(found.faults.map((one) => one.place))];
      groups.append(...places.map((place) => make("section", { class: "card" }, make("h2", {}, place), ...found.faults.filter((one) => one.place === place).map(fault))));
    }
    tell(found.on);
    allow();
  }

  function tell(on) {
    const key = JSON.stringify(on);
    if (active.dataset.key === key) return;
    active.dataset.key = key;
    const list = on.map((one) =>
      make("p", { class: "fault on" }, make("b", {}, one.label), ` ${Object.entries(one.values).map(([name, value]) => `${name} ${value}`).join(", ")} `,
        button("Switch off", () => order("/api/faults/off", { name: one.label }))));
    active.replaceChildren(make("h2", {}, "Active faults"), ...(list.length ? [...list, list.length > 1 ? button("Switch all off", () => order("/api/faults/off", { name: "all" })) : ""] : [make("p", { class: "said" }, "No fault is active.")]));
    buttons = buttons.filter((one) => one.isConnected);
    allow();
  }

  function fault(one) {
    const inputs = one.parameters.map((each) => {
      const attributes = { name: each.name, "aria-label": `${one.name} ${each.name}`, title: each.text };
      return each.choices
        ? make("select", attributes, ...each.choices.map((text) => make("option", { selected: text === each.usual }, text)))
        : make("input", { ...attributes, value: each.usual ?? "", autocomplete: "off" });
    });
    const spans = one.parameters.map((each) => make("small", {}, each.choices ? "" : each.span));
    const sensor = inputs.find((input) => input.name === "sensor");
    const chosen = () => one.parameters.forEach((each, k) => {
      if (each.spans) inputs[k].placeholder = spans[k].textContent = each.spans[sensor.value];
    });
    sensor?.addEventListener("change", chosen);
    chosen();
    const lasting = make("input", { class: "lasting", placeholder: "until switched off", "aria-label": `${one.name} for`, title: "duration with unit, such as 3 s" });
    const go = () => order("/api/faults/on", { name: one.name, values: Object.fromEntries(inputs.filter((input) => input.value).map((input) => [input.name, input.value])), for: lasting.value });
    return make("details", { class: "fault", "data-fault": one.name },
      make("summary", {}, make("b", {}, one.name), ` ${one.title}`),
      make("p", { class: "said" }, `Symptoms: ${one.seen}`),
      make("div", { class: "fields" }, ...inputs.map((input, k) => make("label", {}, one.parameters[k].name.replaceAll("_", " "), spans[k], input)), make("label", {}, "duration", lasting)),
      button("Switch on", go, "main"));
  }

  function button(text, act, kind = "") {
    const element = make("button", { class: kind, onclick: act }, text);
    buttons.push(element);
    return element;
  }

  function allow() {
    const seat = panel.link.status?.access.seat;
    buttons.forEach((one) => {
      one.disabled = !seat;
      one.title = seat ? "" : "only the page that controls the rig may do this";
    });
  }

  async function order(path, body) {
    wrong.textContent = "";
    try {
      await panel.link.order(path, body);
      await load();
    } catch (error) {
      wrong.textContent = error.message;
    }
  }
}
