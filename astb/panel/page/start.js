/** What it takes to start a run: plan, specimen and parameters, who runs it and in which surroundings. */

import { duration, make } from "/page/format.js";
import { followed } from "/page/rehearsal.js";
import { asked, remembered } from "/page/tables.js";
import { help } from "/page/words.js";

export function starting(panel, order, told) {
  let plans = new Map();
  const choice = make("select", { "aria-label": "plan" });
  const about = make("p", { class: "said", id: "about" });
  const instruction = make("p", { class: "instruction" });
  const checked = make("dl", { class: "meanings" });
  const unusable = make("p", { class: "said warning", id: "unusable" });
  const why = make("details", {}, make("summary", {}, "Checks and their purpose"), checked);
  const fields = make("div");
  const specimen = make("select", { "aria-label": "specimen" });
  const twin = make("input", { type: "checkbox", id: "twin" });
  const [operator, ambient] = [remembered("operator", "name"), remembered("ambient", "such as 21 °C, 1013 hPa")];
  const begin = make("button", { class: "main", id: "start" }, "Start");
  const rehearse = make("button", { id: "rehearse", title: "Runs the plan in virtual time, without the rig, and shows the margin to each limit" }, "Rehearse");
  const rehearsed = make("p", { class: "said", id: "rehearsed" });
  const reset = make("button", {}, "Reset fault");
  const vent = make("button", {}, "Vent springs");
  const last = make("div", { id: "last" });
  const lacks = panel.about?.lacks_stop ?? "";
  const stopless = make("p", { class: "wrong" }, lacks && `No run can start, because the panel cannot stop this rig: ${lacks}.`);
  const { button, text } = help("AW0", "AW3", "specimen", "hold");

  function offer(found) {
    const chosen = choice.value || "aw0";
    plans = new Map(found.plans.map((one) => [one.name, one]));
    const group = (label, judges) => make("optgroup", { label }, ...found.plans.filter((one) => one.judges === judges).map((one) => make("option", { value: one.name, title: one.title }, one.name)));
    choice.replaceChildren(group("Plans that judge a spring", true), group("Plans that record data for a diagnosis", false));
    if (plans.has(chosen)) choice.value = chosen;
    unusable.textContent = found.unusable.length ? `Plans with errors, which cannot run: ${found.unusable.join("; ")}` : "";
    unusable.hidden = !found.unusable.length;
    const now = specimen.value;
    specimen.replaceChildren(make("option", { value: "" }, "the spring of the rig file"), ...found.specimens.map((one) => make("option", { value: one }, one)));
    specimen.value = found.specimens.includes(now) ? now : "";
    tellAbout();
  }
  function tellAbout() {
    const plan = plans.get(choice.value);
    about.textContent = plan.title + (plan.lasts ? ` About ${duration(plan.lasts)}.` : "");
    instruction.textContent = plan.instruction;
    why.hidden = !plan.checks.length; // a plan of one's own may declare none
    checked.replaceChildren(...plan.checks.flatMap((one) => [make("dt", {}, one.name), make("dd", {}, one.about)]));
  }
  function choose() {
    tellAbout();
    fields.replaceChildren(...plans.get(choice.value).parameters.flatMap(field));
  }
  const field = (one) => {
    const input = one.choices.length
      ? make("select", { name: one.name }, ...one.choices.map((text) => make("option", { selected: text === one.default }, text)))
      : make("input", { name: one.name, value: one.default, autocomplete: "off" });
    return [make("label", { for: `set-${one.name}` }, one.name.replaceAll("_", " "), one.choices.length ? null : make("small", {}, one.allowed)), Object.assign(input, { id: `set-${one.name}` })];
  };
  /** What a plan is told as depends on what the specimen has to carry. */
  async function ask() {
    const { found, error } = await asked(`/api/plans?specimen=${encodeURIComponent(specimen.value)}`);
    found ? offer(found) : (about.textContent = error);
  }
  offer(panel.plans);
  choose();
  ask(); // of specimens that were brought since this page was loaded
  choice.addEventListener("change", choose);
  specimen.addEventListener("change", ask);
  /** The plan with its specimen and the parameters that are not what they are by default. */
  function chosen() {
    const given = plans.get(choice.value).parameters;
    const set = Object.fromEntries([...fields.querySelectorAll("[name]")].filter((one) => one.value !== given.find((p) => p.name === one.name).default).map((one) => [one.name, one.value]));
    return { plan: choice.value, set, specimen: specimen.value };
  }
  begin.addEventListener("click", () => order("/api/run/start", { ...chosen(), operator: operator.value, ambient: ambient.value, twin: twin.checked }));
  let leave = () => {};
  rehearse.addEventListener("click", async () => {
    await order("/api/rehearsal/start", chosen());
    follow();
  });
  /** Look how the rehearsal stands until it has ended. */
  function follow() {
    leave();
    leave = followed(rehearsed);
  }
  follow();
  reset.addEventListener("click", () => order("/api/reset"));
  vent.addEventListener("click", () => order("/api/vent"));

  return {
    element: make("div", {}, last, make("h2", {}, "Run a plan", button), text, unusable, choice, about, make("details", {}, make("summary", {}, "What the plan does"), instruction), why, fields,
      make("label", {}, "specimen"), specimen,
      make("div", { class: "pair" }, make("label", {}, "operator", operator), make("label", {}, "ambient conditions", ambient)),
      make("label", { class: "check", title: "A model runs in parallel with the rig. The panel shows deviations, their start and their possible causes." }, twin, " compare with the model"),
      make("div", { class: "buttons" }, begin, rehearse), stopless, rehearsed, make("div", { class: "buttons" }, reset, vent)),
    tell(rig, runs, access) {
      const lost = rig.link !== "";
      begin.disabled = !access.seat || lost || lacks !== "";
      rehearse.disabled = !access.seat;
      reset.disabled = vent.disabled = !access.seat || lost;
      const key = JSON.stringify([runs.last, runs.stopped]);
      if (last.dataset.key !== key) {
        last.dataset.key = key;
        last.replaceChildren(...told(runs));
      }
    },
  };
}
