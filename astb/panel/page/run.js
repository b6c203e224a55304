/** The card of the run: what may be started, or what goes on: watch, hold, answer and stop it; then what it came to. */

import { clock, duration, make } from "/page/format.js";
import { starting } from "/page/start.js";
import { help } from "/page/words.js";

const UNDER_A_FINGER = 700; // ms: what was meant for the question before does not answer the one that comes

export function runCard(panel) {
  const element = make("section", { class: "card run", "aria-label": "run" });
  const wrong = make("p", { class: "wrong", role: "alert" });
  const order = (path, body) => {
    wrong.textContent = "";
    return panel.link.order(path, body).catch((error) => (wrong.textContent = error.message));
  };
  const start = starting(panel, order, told);
  const going = running(order);
  element.append(start.element, going.element, wrong);
  return {
    element,
    tell({ rig, runs, access }) {
      const goes = rig.run !== null || rig.pid !== null || runs.starting || runs.ending;
      start.element.hidden = goes;
      going.element.hidden = !goes;
      goes ? going.tell(rig, runs, access) : start.tell(rig, runs, access);
    },
  };
}

const SHOWN = 5; // failed checks, until somebody opens the report

function told({ last, stopped }) {
  const parts = stopped ? ended(stopped) : [];
  if (!last) return parts;
  const { button, text } = help(last.verdict);
  const reason = last.reason && make("p", { class: "said" }, last.reason);
  return [
    ...parts,
    make("h2", {}, `Last run${last.plan ? `: ${last.plan}` : ""}`),
    make("div", { class: `verdict ${last.verdict}` }, last.verdict, button),
    text,
    reason && stopped ? make("details", {}, make("summary", {}, "Reason in the report"), reason) : reason,
    failures(last.failed ?? []),
    last.record ? make("p", {}, make("a", { href: `/kept/report?run=${encodeURIComponent(last.record)}`, target: "_blank" }, "Report")) : null,
  ].filter(Boolean);
}

/** What became of a STOP: who, when, and since when the springs are empty. */
function ended({ by, at, how, empty }) {
  const air = empty === null ? "the springs still hold air and are being vented" : `springs empty at ${clock(empty)}`;
  return [make("p", { class: `stopped ${empty === null ? "wrong" : ""}` }, `Stopped by ${by} at ${clock(at)}; ${air}.`), make("p", { class: "said" }, how)];
}

/** The result of the model that runs in parallel: deviations, or the share of the run that was compared. */
function besides(twin) {
  if (!twin) return [];
  if (twin.partings.length) return [make("ul", { class: "failed" }, ...twin.partings.map((one) => make("li", {}, one)))];
  const why = twin.why ? `. Not compared now: ${twin.why}` : "";
  return [make("p", { class: "said" }, `No deviation from the model in ${duration(twin.judged)} of ${duration(twin.until)}${why}`)];
}

/** The checks that failed, by name, value and limits; afterwards with what they are for. */
function failures(checks) {
  if (!checks.length) return null;
  const more = checks.length > SHOWN ? [make("li", {}, `and ${checks.length - SHOWN} more`)] : [];
  return make("ul", { class: "failed" }, ...checks.slice(0, SHOWN).map((one) => make("li", {}, one.text ?? one, one.about ? make("small", {}, one.about) : null)), ...more);
}

function running(order) {
  const title = make("h3");
  const step = make("p", { class: "said" });
  const bar = make("progress", { max: 1 });
  const times = make("p", { class: "said" });
  const checks = make("p", { class: "said" });
  const failed = make("div");
  const beside = make("div", { id: "beside" });
  const left = make("p", { class: "said" });
  const said = make("p", { class: "said" });
  const question = make("div", { class: "question", id: "question", hidden: true });
  const hold = make("button", { id: "hold", "aria-describedby": "no-hold" }, "Hold");
  const why = make("p", { class: "said", id: "no-hold" });
  const stop = make("button", { id: "stop" }, "End run");
  let held = false;
  let since = 0; // when the question came
  hold.addEventListener("click", () => order(held ? "/api/run/resume" : "/api/run/hold"));
  stop.addEventListener("click", () => order("/api/run/stop"));

  return {
    element: make("div", { hidden: true }, make("h2", {}, "Run"), title, step, bar, times, question, checks, failed, beside, said, make("div", { class: "buttons" }, hold, stop), why),
    tell({ run }, { starting, ending }, { seat }) {
      hold.disabled = !seat || !run;
      stop.disabled = !seat || ending;
      if (!run) {
        title.textContent = starting ? "Starting …" : ending ? "Ending …" : "The next plan starts soon";
        [step, times, checks, failed, beside, said, why].forEach((one) => (one.textContent = ""));
        question.hidden = hold.hidden = true;
        bar.removeAttribute("value");
        return;
      }
      hold.hidden = !run.can_hold;
      held = run.hold_wanted_by !== "";
      hold.disabled ||= !held && run.cannot_hold !== "";
      why.textContent = run.can_hold ? run.cannot_hold : "";
      title.textContent = run.plan;
      step.replaceChildren(make("b", {}, run.step.join(" › ") || "–"), run.next ? `, then ${run.next}` : "");
      bar.value = run.fraction;
      times.textContent = `${duration(run.time)} since the start${run.left === null ? "" : `, about ${duration(run.left)} left`}`;
      checks.textContent = [...Object.entries(run.checks).map(([verdict, count]) => `${count} ${verdict}`)].join(", ") + (run.last_check ? `. Last check: ${run.last_check}` : "");
      const names = JSON.stringify(run.failed);
      if (failed.dataset.names !== names) {
        failed.dataset.names = names;
        failed.replaceChildren(failures(run.failed) ?? "");
      }
      beside.replaceChildren(...besides(run.twin));
      said.textContent = run.held ? `Held ${run.held}` : held ? "The run will be held at its next hold point. Without a further hold point, it runs to its end." : run.question ? "" : run.said;
      hold.textContent = held ? "Continue" : "Hold";
      if (question.dataset.text !== run.question) {
        const to = run.question;
        question.dataset.text = to;
        since = Date.now();
        question.replaceChildren(
          make("p", {}, run.question),
          left,
          make("div", { class: "buttons" }, ...run.answers.map((answer) => make("button", { class: answer === run.answers[0] ? "main" : "", onclick: () => order("/api/run/answer", { answer, to }) }, answer))),
        );
      }
      question.hidden = !run.question;
      left.textContent = run.answer_within === null ? "" : `${duration(run.answer_within)} left to answer`;
      question.querySelectorAll("button").forEach((one) => (one.disabled = !seat || Date.now() - since < UNDER_A_FINGER));
    },
  };
}
