/** What lists share: a question to the server, a table, a choice, a date. */

import { make } from "/page/format.js";

/** Ask the server: `{found}`, or `{error}` in words. */
export async function asked(path) {
  try {
    const answer = await fetch(path, { signal: AbortSignal.timeout(20000) });
    if (!answer.ok) return { error: (await answer.text()).trim() };
    const found = await answer.json();
    return found?.error ? { error: found.error } : { found };
  } catch {
    return { error: "the panel's server does not answer" };
  }
}

/** Do `load` now and again, `pause` ms after it has ended. Returns what ends it. */
export function repeated(load, pause) {
  let timer = null;
  let over = false;
  const go = async () => {
    try {
      await load();
    } finally {
      if (!over) timer = setTimeout(go, pause);
    }
  };
  go();
  return () => {
    over = true;
    clearTimeout(timer);
  };
}

/** A table of rows `{cells, choose}`; a row that can be chosen is told so by a click beside its links. */
export function table(heads, rows) {
  return make("table", { class: "list" },
    make("thead", {}, make("tr", {}, ...heads.map((text) => make("th", {}, text)))),
    make("tbody", {}, ...rows.map(({ cells, choose, mark }) => {
      const row = make("tr", { class: [choose ? "open" : "", mark ?? ""].join(" ").trim() }, ...cells.map((one, k) => make("td", { "data-head": heads[k] }, one)));
      if (choose) row.addEventListener("click", (event) => event.target.closest("a, input, label, button, select") || choose());
      return row;
    })));
}

/** A choice among what there is, with one for any. */
export function choice(label, any, changed) {
  const element = make("select", { "aria-label": label, onchange: changed });
  const offer = (names) => {
    const value = element.value;
    element.replaceChildren(make("option", { value: "" }, any), ...names.map((name) => make("option", { value: name }, name)));
    element.value = names.includes(value) ? value : "";
  };
  offer([]);
  return { element, offer, get value() { return element.value; } };
}

/** A field whose words this browser keeps for the next time, by its name. */
export function remembered(name, placeholder) {
  const element = make("input", { "aria-label": name, placeholder, value: localStorage.getItem(name) ?? "" });
  element.addEventListener("change", () => localStorage.setItem(name, element.value));
  return element;
}

/** A date in UTC by the clock on the wall here. */
export function when(iso) {
  const date = new Date(iso);
  const two = (number) => String(number).padStart(2, "0");
  const day = [date.getFullYear(), two(date.getMonth() + 1), two(date.getDate())].join("-");
  return Number.isNaN(date.getTime()) ? iso : `${day.replaceAll("-", "\u2011")} ${two(date.getHours())}:${two(date.getMinutes())}`;
}

/** A name that may go on in a new line behind each of its signs. */
export function name(text) {
  return text.replace(/_/g, "$&\u200b");
}
