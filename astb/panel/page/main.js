/** The page: shows the rig's state and the emergency stop above whatever view is open. */

import { clock, duration, make } from "/page/format.js";
import { Link } from "/page/link.js";
import { tabTitle } from "/page/title.js";

const LIVE = ["AIR_LOW", "AIR_HIGH", "HOLD", "ACTIVE"];
const find = (name) => document.querySelector(`[data-of=${name}]`);
const news = document.getElementById("news");

const link = new Link();
window.addEventListener("stopped", tell); // by stop.js, which was there first
await window.astb.entered;
let lacksStop = ""; // not known until the rig is described
link.listen(tell);
link.begin();
const panel = { link, about: await fetched("/api/rig"), plans: await fetched("/api/plans") };
lacksStop = panel.about.lacks_stop;
find("rig").textContent = panel.about.name;
find("kind").textContent = panel.about.simulated ? "simulated rig" : panel.about.description || "real rig";
document.getElementById("estop").title = "Commands the rig to its safe position: the actuators hold, and the air is vented. It does not replace the emergency stop button of the rig.";

const views = panel.about.views.map(({ name, title }) => ({ name, title, button: make("button", { onclick: () => (location.hash = name) }, title) }));
document.getElementById("views").append(...views.map((one) => one.button));
window.addEventListener("hashchange", open);
let leave = () => {};
await open();

async function fetched(path) {
  for (;;) {
    try {
      const answer = await fetch(path);
      if (answer.ok) return await answer.json();
    } catch {
      /* the server comes back */
    }
    await new Promise((done) => setTimeout(done, 1000));
  }
}

async function open() {
  const { hash } = location;
  const chosen = views.find((one) => `#${one.name}` === hash) ?? views[0];
  leave();
  views.forEach((one) => (one === chosen ? one.button.setAttribute("aria-current", "page") : one.button.removeAttribute("aria-current")));
  leave = () => {};
  const element = document.getElementById("view");
  element.replaceChildren();
  const { show } = await import(`/page/${chosen.name}.js`);
  if (location.hash !== hash) return; // somebody has chosen another one meanwhile
  leave = show(element, panel) ?? (() => {});
}

function tell() {
  const { status, stale } = link;
  document.body.classList.toggle("stale", stale || (status && status.rig.link !== ""));
  say(stale, status);
  if (!status) return;
  const { rig, access } = status;
  const fault = !LIVE.includes(rig.state) && (rig.state.startsWith("FAULT") || rig.state === "ESTOP");
  const state = document.getElementById("state");
  state.className = `state ${fault ? "fault" : LIVE.includes(rig.state) ? "up" : ""}`;
  find("state").textContent = rig.state.replaceAll("_", " ");
  find("why").textContent = [rig.reason, fault && rig.first_out].filter(Boolean).join(", ");
  const idle = lacksStop ? "not available on this rig" : access.token ? "" : "not allowed from this page";
  document.getElementById("estop").classList.toggle("watching", idle !== "");
  find("stops").textContent = idle || "by software";
  find("punctual").textContent = rig.late === null ? "" : `${rig.late} late ticks${rig.lease ? "" : ", no run on the rig"}`;
  seat(access);
  document.title = tabTitle(status, stale, fault, find("rig").textContent);
}

function say(stale, status) {
  const since = link.heard && clock(link.heard);
  const lost = stale ? (since ? `No data from the panel's server since ${since} (${duration((Date.now() - link.heard) / 1000)}). The page shows old values.` : "The panel's server does not answer yet. If this stays, start `astb panel` again.")
    : status?.rig.link ? `No data from the rig: ${status.rig.link}` : "";
  const text = [window.astb.stopped, lost].filter(Boolean).join(" ");
  news.textContent = text;
  news.hidden = !text;
}

function seat({ token, seat: mine, taken, pages }) {
  const element = document.getElementById("seat");
  const key = JSON.stringify([token, mine, taken, pages]);
  if (element.dataset.key === key) return;
  element.dataset.key = key;
  const others = pages > 1 ? `${pages} pages are open` : "";
  if (mine) element.replaceChildren(make("b", {}, "This page controls the rig"), others);
  else if (!token) element.replaceChildren(make("b", {}, "This page only shows the rig"), others);
  else element.replaceChildren(make("b", {}, "Another page controls the rig"), make("button", { id: "take", onclick: () => link.order("/api/seat").catch(() => {}) }, "Take over"));
}
