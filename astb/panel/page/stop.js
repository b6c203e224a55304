/** What works before anything else of the page is there: the token of the address, and STOP. Loaded before the body. */

"use strict";

const KEEP_OPEN = 20000; // ms
window.astb = { entered: enter(), stopped: "", order };
document.addEventListener("click", ({ target }) => target.closest("#estop") && stop());
// A stop on an open connection reaches the server at once, even while many others try to connect.
setInterval(() => fetch("/", { method: "HEAD" }).catch(() => {}), KEEP_OPEN);

/** Exchange the token of the address for a cookie, and let it not stand there for others to read. */
async function enter() {
  const token = new URLSearchParams(location.hash.slice(1)).get("token");
  if (!token) return;
  try {
    await fetch("/api/enter", { method: "POST", body: JSON.stringify({ token }), signal: AbortSignal.timeout(5000) });
    history.replaceState(null, "", location.pathname);
  } catch {
    /* the address still has it when the page is loaded again */
  }
}

/** Tell the rig to take its safe position; what went wrong stands in `astb.stopped`. */
async function stop() {
  say("");
  try {
    await window.astb.entered;
    await order("/api/estop", { by: who() });
  } catch (error) {
    say(`STOP did not work. Press the emergency stop of the rig. Reason: ${error.message}`);
  }
}

/** The name in the operator's field, as far as this browser keeps one; a stop never fails for it. */
function who() {
  try {
    return localStorage.getItem("operator") ?? "";
  } catch {
    return "";
  }
}

/** Give an order to the panel's server, and return what was done; throws an Error with its words if it is refused. */
async function order(path, body = {}, headers = {}) {
  let answer;
  try {
    answer = await fetch(path, {
      method: "POST",
      headers: { "Content-Type": "application/json", ...headers },
      body: JSON.stringify(body),
      signal: AbortSignal.timeout(5000),
    });
  } catch {
    throw new Error("the panel's server does not answer");
  }
  const told = await answer.json().catch(() => ({ error: `the panel's server failed (${answer.status})` }));
  if (told.error) throw new Error(told.error);
  return told.done;
}

function say(words) {
  window.astb.stopped = words;
  const news = document.getElementById("news");
  news.textContent = words;
  news.hidden = !words;
  window.dispatchEvent(new Event("stopped"));
}
