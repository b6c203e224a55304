/** The view of past diagnoses: what each found, and its report. */

import { make } from "/page/format.js";
import { asked, name, table, when } from "/page/tables.js";

export function show(element) {
  const card = make("section", { class: "card", "aria-label": "diagnoses" });
  element.append(make("div", { class: "view" }, card));
  load();
  return () => {};

  async function load() {
    const { found, error } = await asked("/api/diagnoses");
    if (error) return card.replaceChildren(make("p", { class: "wrong" }, error));
    if (!found.length) return card.replaceChildren(make("p", { class: "said" }, "There is no diagnosis in this folder. Write one from a run with `astb diagnose RUN --out FOLDER/NAME`, or on a rig with `astb investigate`."));
    card.replaceChildren(table(["verdict", "diagnosis", "when", "result", "model"], found.map((one) => ({
      cells: [
        make("b", { class: `verdict-word ${one.verdict}` }, one.verdict.replaceAll("_", " ")),
        make("a", { href: `/kept/diagnosis?of=${encodeURIComponent(one.directory)}`, target: "_blank" }, name(one.directory)),
        when(one.written), one.sentence, one.simulator,
      ],
    }))));
  }
}
