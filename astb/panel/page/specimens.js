/** The view of specimens: what each file says, and a file of one's own, which is checked before it is kept. */

import { make } from "/page/format.js";
import { asked, name, table } from "/page/tables.js";

export function show(element, panel) {
  const wrong = make("p", { class: "wrong", role: "alert" });
  const said = make("p", { class: "said", role: "status" });
  const file = make("input", { type: "file", accept: ".toml", "aria-label": "file of a specimen" });
  const instead = make("button", { hidden: true }, "Replace the existing file");
  const list = make("div", { class: "rows" });
  const facts = make("section", { class: "card", "aria-label": "specimen", hidden: true });
  let brought = null; // the file that was chosen last
  element.append(
    make("div", { class: "view" },
      make("section", { class: "card" }, make("h2", {}, "Add a file"),
        make("p", { class: "said" }, "A specimen is a TOML file with drawing, loads and limits. `astb copy specimen astb mine.toml` writes an example. The panel checks the file and stores it with the runs."),
        make("div", { class: "filters" }, file, instead), wrong, said),
      make("section", { class: "card", "aria-label": "specimens" }, list), facts));
  file.addEventListener("change", async () => {
    const [one] = file.files;
    if (!one) return;
    brought = { name: one.name, text: await one.text() };
    file.value = "";
    add(false);
  });
  instead.addEventListener("click", () => add(true));
  const leave = panel.link.listen(() => (file.disabled = !panel.link.status?.access.seat));
  load();
  return leave;

  async function add(replace) {
    wrong.textContent = said.textContent = "";
    instead.hidden = true;
    try {
      const added = await panel.link.order("/api/specimens/add", { ...brought, instead: replace });
      said.textContent = `${added} is valid. You can choose it for a run now.`;
      await load();
      await told(added);
    } catch (error) {
      wrong.textContent = error.message;
      instead.hidden = !error.message.includes("exists already with other contents");
    }
  }

  async function load() {
    const { found, error } = await asked("/api/specimens");
    if (error) return list.replaceChildren(make("p", { class: "wrong" }, error));
    list.replaceChildren(table(["specimen", "type", "serial number", "drawing", "loads"], found.map((one) => ({
      choose: () => told(one.name),
      mark: one.error ? "off" : "",
      cells: one.error ? [name(one.name), one.error, "", "", ""]
        : [make("button", { onclick: () => told(one.name) }, one.name), one.type, one.serial_number, one.drawing, Object.entries(one.loads).map(([load, carried]) => `${load} ${carried}`).join(", ")],
    }))));
  }

  async function told(of) {
    const { found, error } = await asked(`/api/specimens/one?name=${encodeURIComponent(of)}`);
    facts.hidden = false;
    if (error) return facts.replaceChildren(make("p", { class: "wrong" }, error));
    facts.replaceChildren(make("h2", { class: "title" }, found.name), make("p", { class: "said" }, found.error || `${found.type}, no. ${found.serial_number}, ${found.drawing}`),
      table(["property", "value or limits", "kind of source", "source"], found.rows.map((row) => ({ cells: [row.name, row.says, row.provenance, row.source] }))));
    facts.scrollIntoView({ block: "nearest" });
  }
}
