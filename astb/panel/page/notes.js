/** The notes on a run: what was added to it afterwards, and a form that adds more. */

import { make } from "/page/format.js";
import { asked, remembered, when } from "/page/tables.js";

const PATIENCE = 120000; // ms, for a photo over a slow network

export function notes(panel, run, changed) {
  const list = make("div");
  const wrong = make("p", { class: "wrong", role: "alert" });
  const text = make("textarea", { "aria-label": "note", rows: 2, placeholder: "text of the note" });
  const by = remembered("operator", "author");
  const files = make("input", { type: "file", multiple: true, "aria-label": "photos or files" });
  const token = panel.link.status?.access.token;
  const add = make("button", { disabled: !token, title: token ? "" : "this page can only watch" }, "Add");
  add.addEventListener("click", async () => {
    wrong.textContent = "";
    add.disabled = true;
    try {
      const some = [...files.files];
      for (const [place, file] of (some.length ? some : [null]).entries()) await send(run, by.value, place ? "" : text.value, file);
      text.value = files.value = "";
      changed();
    } catch (error) {
      wrong.textContent = error.message;
    }
    add.disabled = false;
    await load();
  });
  load();
  return make("section", { class: "notes", "aria-label": "notes" }, make("h3", {}, "Notes"), list,
    make("details", {}, make("summary", {}, "Add a note, a photo or a file"), text, make("div", { class: "filters" }, by, files, add), wrong,
      make("p", { class: "said" }, "The note is stored with the run, with its time and author. Recorded and signed files do not change.")));

  async function load() {
    const { found, error } = await asked(`/api/kept/notes?run=${encodeURIComponent(run)}`);
    list.replaceChildren(...(found ?? []).map(shown));
    if (error) list.replaceChildren(make("p", { class: "wrong" }, error));
    if (found && !found.length) list.replaceChildren(make("p", { class: "said" }, "This run has no notes."));
  }

  function shown(one) {
    const address = `/kept/note?run=${encodeURIComponent(run)}&file=${encodeURIComponent(one.file)}`;
    const file = !one.file ? "" : !one.intact ? make("p", { class: "wrong" }, `${one.file} is missing or was changed after it was added`)
      : make("a", { href: address, target: "_blank" }, one.picture ? make("img", { src: address, alt: one.file, loading: "lazy" }) : one.file);
    return make("div", { class: "note" }, make("small", {}, [when(one.at), one.by].filter(Boolean).join(", ")), make("p", {}, one.text), file);
  }
}

async function send(run, by, text, file) {
  const words = new URLSearchParams({ run, by, text, ...(file ? { file: file.name } : {}) });
  let answer;
  try {
    answer = await fetch(`/api/kept/note?${words}`, { method: "POST", body: file ?? "", headers: { "Content-Type": "application/octet-stream" }, signal: AbortSignal.timeout(PATIENCE) });
  } catch {
    throw new Error("the panel's server does not answer");
  }
  const told = await answer.json().catch(() => ({ error: `the panel's server failed (${answer.status})` }));
  if (told.error) throw new Error(told.error);
}
