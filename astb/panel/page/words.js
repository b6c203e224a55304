/** What the words of the bench mean, said where they stand. */

import { make } from "/page/format.js";

export const WORDS = {
  // what may be chosen
  "AW0": "The load case of the empty car. The specimen's file states the load of each spring.",
  "AW3": "The load case of the full car. The specimen's file states the load of each spring.",
  "specimen": "The spring on the bench. Its file states its drawing, its loads and its limits.",
  "hold": "The run stops at the next hold point of its plan. The valves are shut and the actuators are still. “Continue” resumes it. After its last hold point, a run cannot be held.",
  // how a check ends
  "pass": "All judged values are within their limits.",
  "marginal": "Within the limits, but with the measurement uncertainty the value may be outside. The check passes; inspect the value.",
  "fail": "A judged value is outside a limit: the spring does not meet its file. Open the report for the value.",
  "error": "No value was measured, so the check does not pass. The reason is in the report.",
  "not available": "This rig cannot measure the value. The reason is shown next to the check.",
  // how a run ends
  "incomplete": "All checks that this rig can measure pass, but some checks are not available.",
  "blocked": "The spring was not judged, because the run could not be completed. Remove the reason that is shown, and run again.",
  "interrupted": "The run ended before it could write its result. The record up to this time is kept.",
  "running": "The run is in progress.",
  // the contacts of the rig
  "estop": "The emergency stop button of the rig. After it was pressed, release the button, then click “Reset fault”.",
  "pneumatic": "The contact of the interlock that removes the pressure. It is open while the bench is at rest, and closes when the air is on.",
  "program": "The contact of the interlock that stops the function generator. It is open while the bench is at rest, and closes before the bench moves.",
  "command": "Shows whether valid commands arrive in time.",
  "limits": "Shows whether a limit has tripped since the last reset.",
  "fault": "Shows whether a fault is stored. “Reset fault” clears it.",
  "staged": "Shows whether the rig has new settings that are not applied yet.",
};

/** Names of the contacts on the page. */
export const LABELS = { estop: "emergency stop", pneumatic: "pressure interlock", program: "generator interlock", command: "commands", limits: "limits", fault: "fault", staged: "new settings" };

const label = (word) => LABELS[word] ?? word;

/** A button with "?" that says beside it what a word means. */
export function help(...words) {
  const known = words.filter((one) => one in WORDS);
  const text = make("p", { class: "said help", hidden: true, role: "note" });
  const button = make("button", { class: "ask", "aria-expanded": "false", "aria-label": `what is ${known.map(label).join(", ")}` }, "?");
  text.append(...known.flatMap((one, k) => [...(k ? [make("br")] : []), make("b", {}, label(one)), `: ${WORDS[one]}`]));
  button.addEventListener("click", () => {
    text.hidden = !text.hidden;
    button.setAttribute("aria-expanded", String(!text.hidden));
  });
  return { button, text };
}
