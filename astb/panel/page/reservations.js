/** The view of reservations: who has the rig from when until when, and a form that adds one. */

import { make } from "/page/format.js";
import { asked, remembered, repeated, table, when } from "/page/tables.js";

const PAUSE = 10000; // ms

export function show(element, panel) {
  const wrong = make("p", { class: "wrong", role: "alert" });
  const list = make("div", { class: "rows" });
  const by = remembered("operator", "operator");
  const [start, end] = ["from", "until"].map((label) => make("input", { type: "datetime-local", "aria-label": label }));
  const purpose = make("input", { "aria-label": "purpose", placeholder: "purpose (optional)" });
  const token = () => Boolean(panel.link.status?.access.token);
  const add = make("button", { class: "main" }, "Reserve");
  const instant = (field) => (field.value ? new Date(field.value).toISOString() : "");
  add.addEventListener("click", () => change("add", { by: by.value, start: instant(start), end: instant(end), purpose: purpose.value }));
  element.append(
    make("div", { class: "view" },
      make("section", { class: "card" }, make("h2", {}, "Reserve the rig"),
        make("p", { class: "said" }, "During a reservation, only its operator can start runs. Before it, other operators can only start runs that end before it begins. `astb run --wait` waits until the rig is free."),
        make("div", { class: "filters" }, make("label", {}, "operator", by), make("label", {}, "from", start), make("label", {}, "until", end), make("label", {}, "purpose", purpose), add), wrong),
      make("section", { class: "card", "aria-label": "reservations" }, list)));
  const leave = panel.link.listen(() => [add, ...list.querySelectorAll("button")].forEach((one) => (one.disabled = !token())));
  const stop = repeated(load, PAUSE);
  return () => {
    leave();
    stop();
  };

  async function change(what, body) {
    wrong.textContent = "";
    try {
      await panel.link.order(`/api/reservations/${what}`, body);
    } catch (error) {
      wrong.textContent = error.message;
    }
    await load();
  }

  async function load() {
    const { found, error } = await asked("/api/reservations");
    if (error) return list.replaceChildren(make("p", { class: "wrong" }, error));
    if (!found.length) return list.replaceChildren(make("p", { class: "said" }, "The rig is not reserved."));
    list.replaceChildren(table(["operator", "from", "until", "purpose", ""], found.map((one) => ({
      cells: [one.by, when(one.start), when(one.end), one.purpose, make("button", { disabled: !token(), onclick: () => change("remove", { start: one.start }) }, "Remove")],
    }))));
  }
}
