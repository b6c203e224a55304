/** What the words of the bench mean, said where they stand. */

import { make } from "/page/format.js";

export const WORDS = {
  // what may be chosen
  "AW0": "The load case of the empty car. The specimen's file states the load of each spring.",
  "AW3": "The load case of the full car. The specimen's file states the load of each spring.",
  "specimen": "The spring on the bench: a file states its drawing, its loads and its limits.",
  "hold": "The run waits at the next hold point of its plan: valves shut, actuators still. It continues from there. After the last hold point it cannot be held.",
  // how a check ends
  "pass": "All judged values are within their limits.",
  "marginal": "Within the limits, but with the measurement uncertainty the value may be outside. The check passes; inspect the value.",
  "fail": "Outside a limit: the spring is not as its file requires.",
  "error": "No value was measured. A check without a value never passes.",
  "not available": "This rig cannot measure it. The reason is shown next to it.",
  // how a run ends
  "incomplete": "All checks that this rig can measure pass, but some checks are not available.",
  "blocked": "The spring was not judged: rig, wires, plan or operator prevented the run from being completed.",
  "interrupted": "The run stopped before it could write its result. The record up to this time is kept.",
  "running": "The run is in progress.",
  // the contacts of the rig
  "estop": "The emergency stop of the hardware. After it was pressed: release the button, then reset.",
  "pneumatic": "The interlock that removes pressure. It is open while the bench is at rest, and closes when the air is on.",
  "program": "The interlock that stops the function generator. It is open while the bench is at rest, and closes before it moves.",
  "command": "Whether valid commands arrive in time.",
  "limits": "Whether a limit has tripped since the last reset.",
  "fault": "Whether a fault is latched, which a reset clears.",
  "staged": "Whether settings were written to the rig that do not act yet; they take effect together when they are applied.",
};

/** A button with "?" that says beside it what a word means. */
export function help(...words) {
  const known = words.filter((one) => one in WORDS);
  const text = make("p", { class: "said help", hidden: true, role: "note" });
  const button = make("button", { class: "ask", "aria-expanded": "false", "aria-label": `what is ${known.join(", ")}` }, "?");
  text.append(...known.flatMap((one, k) => [...(k ? [make("br")] : []), make("b", {}, one), `: ${WORDS[one]}`]));
  button.addEventListener("click", () => {
    text.hidden = !text.hidden;
    button.setAttribute("aria-expanded", String(!text.hidden));
  });
  return { button, text };
}
