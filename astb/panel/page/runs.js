/** The view of past runs: search them, open reports, compare two, follow a check, give a run another name, archive it. */

import { duration, make } from "/page/format.js";
import { asked, choice, name, repeated, table, when } from "/page/tables.js";
import { notes } from "/page/notes.js";
import { goingOn } from "/page/rehearsal.js";
import { help } from "/page/words.js";

const ARCHIVE = "archive/";
const AGAIN = 5000; // ms until the list is looked at anew
const TRENDS = 60; // on one page

export function show(element, panel) {
  const said = make("p", { class: "said" });
  const filters = {
    plan: choice("plan", "any plan", fill),
    verdict: choice("verdict", "any verdict", fill),
    serial_number: choice("specimen", "any specimen", fill),
    rig: choice("rig", "any rig", fill),
  };
  const search = make("input", { type: "search", "aria-label": "search", placeholder: "search", oninput: fill });
  const archived = make("input", { type: "checkbox", "aria-label": "show the archive", onchange: fill });
  const compare = make("a", { class: "button", target: "_blank", "aria-disabled": "true" }, "Compare two");
  const list = make("div", { class: "rows" });
  const checks = make("section", { class: "card checks", "aria-label": "checks", hidden: true });
  const marked = new Set();
  let runs = [];
  let seen = "";
  element.append(
    make("div", { class: "view" },
      make("div", { class: "filters" }, search, ...Object.values(filters).map((one) => one.element), make("label", { class: "tick" }, archived, "archive"), compare),
      said, make("div", { class: "beside" }, make("section", { class: "card", "aria-label": "runs" }, list), checks)),
  );
  return repeated(load, AGAIN);

  async function load() {
    const { found, error } = await asked("/api/kept");
    if (error) return void (said.textContent = error);
    const text = JSON.stringify(found);
    if (text === seen) return;
    seen = text;
    runs = found.runs;
    const left = Object.keys(found.unreadable);
    said.textContent = `${runs.length} runs in the folder ${found.folder}${left.length ? `; not readable: ${left.join(", ")}` : ""}`;
    for (const [column, one] of Object.entries(filters)) one.offer([...new Set(runs.map((run) => run[column]).filter(Boolean))].sort());
    fill();
  }

  function fill() {
    const words = search.value.toLowerCase().split(/\s+/);
    const shown = runs.filter((run) => Object.entries(filters).every(([column, one]) => !one.value || run[column] === one.value)
      && run.directory.startsWith(ARCHIVE) === archived.checked && words.every((word) => told_of(run).includes(word)));
    for (const one of marked) if (!shown.some((run) => run.directory === one)) marked.delete(one);
    list.replaceChildren(table(["compare", "verdict", "run", "when", "plan", "specimen", "duration"], shown.map(row)));
    pair();
  }

  /** What a search looks at: all that the list tells of a run, and why it ended so. */
  function told_of(run) {
    const { directory, plan, title, verdict, reason, rig, operator, specimen, serial_number, parameters, began } = run;
    return [directory, plan, title, verdict, reason, rig, operator, specimen, serial_number, ...Object.entries(parameters).flat(), when(began)].join(" ").toLowerCase();
  }

  function row(run) {
    const mark = make("input", { type: "checkbox", "aria-label": `compare ${run.directory}`, checked: marked.has(run.directory) });
    mark.addEventListener("change", () => {
      mark.checked ? marked.add(run.directory) : marked.delete(run.directory);
      pair();
    });
    const set = [
      ...Object.entries(run.parameters).map(([parameter, value]) => `${parameter} ${value}`),
      ...(run.circumstances.startsWith("SIMULATED") ? ["simulated"] : []),
    ].join(", ");
    const open = run.verdict === "running" ? name(run.directory) : make("a", { href: `/kept/report?run=${encodeURIComponent(run.directory)}`, target: "_blank" }, name(run.directory));
    return {
      cells: [
        make("label", { class: "mark" }, mark),
        make("b", { class: `verdict-word ${run.verdict}`, title: run.reason }, run.verdict),
        make("span", {}, open, run.notes ? make("small", {}, `${run.notes} ${run.notes > 1 ? "notes" : "note"}`) : null),
        when(run.began),
        make("span", { title: run.title }, name(run.plan), set ? make("small", {}, set) : null),
        make("span", {}, run.serial_number, run.operator ? make("small", {}, run.operator) : null), run.duration ? make("span", { class: "nowrap" }, duration(run.duration)) : "",
      ],
      choose: run.verdict === "running" ? null : () => told(run),
    };
  }

  function pair() {
    const [a, b] = runs.filter((run) => marked.has(run.directory)).map((run) => run.directory).reverse();
    const two = marked.size === 2;
    compare.setAttribute("aria-disabled", String(!two));
    two ? compare.setAttribute("href", `/kept/compare?a=${encodeURIComponent(a)}&b=${encodeURIComponent(b)}`) : compare.removeAttribute("href");
    compare.textContent = two ? "Compare these two" : "Mark two runs to compare";
  }

  /** What gives a run another name, or puts it aside; nothing in its folder is touched. */
  function moving(run) {
    const wrong = make("p", { class: "wrong", role: "alert" });
    const field = make("input", { "aria-label": "another name", value: run.directory.split("/").at(-1) });
    const seat = panel.link.status?.access.seat;
    const move = (path, body) => async () => {
      try {
        await panel.link.order(path, { run: run.directory, ...body() });
        checks.hidden = true;
        await load();
      } catch (error) {
        wrong.textContent = error.message;
      }
    };
    const aside = run.directory.startsWith(ARCHIVE) ? ["Bring back", "/api/kept/restore"] : ["Archive", "/api/kept/archive"];
    const buttons = [["Rename", "/api/kept/rename", () => ({ name: field.value })], [...aside, () => ({})]];
    return make("details", {}, make("summary", {}, "Rename or archive"),
      make("div", { class: "filters" }, field, ...buttons.map(([text, path, body]) => make("button", { disabled: !seat, title: seat ? "" : "only the page that commands may do this", onclick: move(path, body) }, text))), wrong);
  }

  /** The run in the drawing of the bench, once somebody asks for it. */
  function replay(run) {
    const place = make("div", { class: "replay" });
    const button = make("button", { onclick: async () => {
      button.disabled = true;
      const { found, error } = await asked(`/api/kept/replay?run=${encodeURIComponent(run.directory)}`);
      if (error) return place.replaceChildren(make("p", { class: "wrong" }, error));
      const again = goingOn(panel, run, () => Number(place.dataset.time));
      window.benchReplay(place, found.told, await window.unpacked(found.packed), again.moved);
      place.append(again.element);
    } }, "Replay");
    place.append(button);
    return place;
  }

  /** One page with the trends of all checks that are marked. */
  function trends(run, places) {
    const link = make("a", { class: "button", target: "_blank", "aria-disabled": "true" }, "Mark checks to show their trends");
    const tell = () => {
      const some = [...places].sort((a, b) => a - b).slice(0, TRENDS);
      link.setAttribute("aria-disabled", String(!some.length));
      some.length ? link.setAttribute("href", trend(run, some)) : link.removeAttribute("href");
      link.textContent = some.length ? `Trends of ${some.length} ${some.length > 1 ? "checks" : "check"}` : "Mark checks to show their trends";
    };
    const mark = (place) => make("input", { type: "checkbox", "aria-label": `trend of check ${place + 1}`, onchange: (event) => {
      event.target.checked ? places.add(place) : places.delete(place);
      tell();
    } });
    return { link, mark };
  }

  function trend(run, places) {
    return `/kept/trend?run=${encodeURIComponent(run.directory)}${places.map((one) => `&place=${one}`).join("")}`;
  }

  async function told(run) {
    const { found, error } = await asked(`/api/kept/checks?run=${encodeURIComponent(run.directory)}`);
    const { button, text } = help(...new Set([run.verdict, ...(found ?? []).map((one) => one.verdict)]));
    const { link, mark } = trends(run, new Set());
    checks.hidden = false;
    checks.replaceChildren(
      make("h2", { class: "title" }, run.directory, button),
      text,
      run.reason ? make("p", { class: "said" }, run.reason) : "",
      moving(run),
      error ? make("p", { class: "wrong" }, error) : "",
      replay(run),
      found?.length > 1 ? link : "",
      ...(found ?? []).map((one, place) =>
        make("p", { class: "check" }, found.length > 1 ? mark(one.place) : "",
          make("b", { class: `verdict-word ${one.verdict}` }, one.verdict), ` ${one.text.replace(/: [^:]*$/, "")} `,
          make("a", { href: trend(run, [one.place]), target: "_blank", title: "This check in all runs of this specimen with the same conditions" }, "trend"),
          one.about && one.about !== found[place - 1]?.about ? make("small", {}, one.about) : "")),
      found && !found.length ? make("p", { class: "said" }, "This run has no checks.") : "",
      notes(panel, run.directory, load),
    );
    checks.scrollIntoView({ block: "nearest" });
  }
}
