/** Rehearsals: how the present one stands, and one that goes on from an instant of a kept run with a change. */

import { make } from "/page/format.js";
import { asked, repeated } from "/page/tables.js";

const KINDS = [["effect", "add an effect", "leak.left=0.5mm2"], ["fault", "add a fault", "leak side=left area=0.5mm2"], ["change", "change a parameter", "orifice_diameter=12mm"]];

/** Tells in `place` how the rehearsal stands until it has ended. Returns what leaves it alone. */
export function followed(place) {
  const leave = repeated(async () => {
    const { found } = await asked("/api/rehearsal");
    if (!found) return;
    if (!found.going) leave();
    if (!found.plan) return;
    const page = found.page && make("a", { href: `/kept/rehearsal?of=${encodeURIComponent(found.page)}`, target: "_blank" }, "Open the rehearsal page");
    const parted = found.otherwise?.length ? make("ul", { class: "meanings" }, ...found.otherwise.map((one) => make("li", {}, one))) : "";
    place.replaceChildren(make("b", {}, `${found.plan}: `), found.going ? "is being rehearsed …" : found.words, " ", page || "", parted);
  }, 1000);
  return leave;
}

/** Goes on from the instant `at()` (s) of a run with what somebody writes; `moved(now)` tells it of another one. */
export function goingOn(panel, run, at) {
  const wrong = make("p", { class: "wrong", role: "alert" });
  const said = make("div", { class: "said", id: "again" });
  const kind = make("select", { "aria-label": "kind of change" }, ...KINDS.map(([value, text]) => make("option", { value }, text)));
  const field = make("input", { "aria-label": "the change", autocomplete: "off" });
  const go = make("button", { id: "rehearse-from" });
  const report = make("a", { class: "button", target: "_blank" }, "Curves at this time");
  const hint = () => (field.placeholder = KINDS.find(([value]) => value === kind.value)[2]);
  let leave = () => {};
  kind.addEventListener("change", hint);
  hint();
  go.addEventListener("click", async () => {
    wrong.textContent = "";
    try {
      await panel.link.order("/api/rehearsal/from", { run: run.directory, at: at(), [kind.value]: field.value });
      leave();
      leave = followed(said);
    } catch (error) {
      wrong.textContent = error.message;
    }
  });
  return {
    element: make("div", { class: "again" }, make("div", { class: "filters" }, kind, field, go, report), wrong, said),
    moved(now) {
      go.textContent = `Rehearse from ${now.toFixed(1)} s`;
      go.disabled = !panel.link.status?.access.seat;
      go.title = go.disabled ? "only the page that controls the rig may do this" : "Repeats the run in virtual time up to this time, then continues with the change";
      report.setAttribute("href", `/kept/report?run=${encodeURIComponent(run.directory)}#t=${now.toFixed(1)}`);
    },
  };
}
