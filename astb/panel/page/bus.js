/** The view of the bus: frames per second by identifier, how late the rig is, who commands it, what it refused. */

import { fixed, make } from "/page/format.js";
import { asked, repeated, table } from "/page/tables.js";

const AGAIN = 1000; // ms
const OVER = 3000; // ms over which a rate is taken
const OFF = 0.1; // of its rate: a message that comes more rarely or more often stands out

export function show(element) {
  const rig = make("section", { class: "card facts", "aria-label": "rig" });
  const frames = make("section", { class: "card", "aria-label": "frames" });
  element.append(make("div", { class: "view" }, rig, frames));
  let past = [];
  return repeated(load, AGAIN);

  async function load() {
    const { found, error } = await asked("/api/bus");
    if (error) {
      rig.replaceChildren();
      return void frames.replaceChildren(make("p", { class: "said" }, error));
    }
    if (past.length && total(found.counts) < total(past.at(-1).counts)) past = []; // it began anew
    past.push(found);
    while (past.length > 2 && found.time - past[1].time > OVER / 1000) past.shift();
    rig.replaceChildren(...facts(found));
    frames.replaceChildren(...rates(past[0], found));
  }
}

function facts({ rig, run }) {
  const { "rig.lease": lease, "rig.holder": holder, "rig.strangers": strangers, "rig.stranger": port, "rig.stranger_identifier": identifier } = rig;
  const worst = rig["rig.lateness_max"];
  const last = identifier ? `CAN frame ${hex(identifier)}` : "a Modbus request";
  return [
    fact("Rig controlled by", ...who(lease, holder, run)),
    fact("Late ticks", fixed(rig["rig.late_ticks"], 0), worst === null ? "" : `largest delay ${fixed(1000 * worst, 2)}\u2009ms`),
    fact("Commands refused", fixed(rig["rig.rejected_commands"], 0), "frames with a wrong checksum or counter"),
    fact("Set-points refused", fixed(rig["rig.refused_setpoints"], 0), "out of range"),
    fact("From other clients", fixed(strangers, 0), strangers ? `last: ${last}${port ? ` from TCP port ${port}` : ""}` : "refused frames and requests without the lease"),
  ];
}

/** Who has the rig: the run, if the rig names its connection, or where else the commands come from. */
function who(lease, holder, run) {
  if (lease === null) return ["–"];
  if (!lease) return ["no client"];
  const port = holder ? `TCP port ${holder}` : "CAN, which does not identify the sender";
  if (run && (run.commands || !holder)) return [`the run ${run.plan}`, [run.operator && `operator ${run.operator}`, port].filter(Boolean).join(", ")];
  return ["another program", holder ? `${port}; the command "ss -tnp" on this machine shows the program` : port];
}

function fact(title, value, more = "") {
  return make("div", { class: "fact" }, make("h2", {}, title), make("b", {}, value), make("small", {}, more));
}

function rates(first, now) {
  const span = now.time - first.time;
  const rate = (id) => (span > 0.5 ? (now.counts[id] - (first.counts[id] ?? 0)) / span : null);
  const known = new Set([...Object.keys(now.messages), ...Object.keys(now.counts)].map(Number));
  const rows = [...known].sort((a, b) => a - b).map((id) => {
    const message = now.messages[id];
    const seen = id in now.counts;
    const found = seen ? rate(id) : span > 0.5 ? 0 : null;
    const wanted = message?.rate ?? null;
    const silent = message?.sender === "commander" && !found; // nobody commands
    const off = !message || (wanted && found !== null && !silent && Math.abs(found / wanted - 1) > OFF);
    return {
      mark: off ? "off" : seen ? "" : "none",
      cells: [hex(id), message?.name ?? "unknown", message?.sender ?? "", fixed(found, 1), wanted ? fixed(wanted, 0) : message ? "not periodic" : "", fixed(now.counts[id] ?? 0, 0), now.gaps[id] ? `${fixed(1000 * now.gaps[id], 1)}\u2009ms` : ""],
    };
  });
  const sum = [...known].reduce((all, id) => all + (now.counts[id] === undefined ? 0 : rate(id) ?? 0), 0);
  return [
    make("h2", {}, now.error || `${fixed(sum, 0)} frames/s${now.others ? `; ${now.others} frames with other identifiers` : ""}`),
    table(["identifier", "message", "sender", "frames/s", "expected/s", "frames counted", "longest gap"], rows),
  ];
}

const hex = (id) => `0x${Number(id).toString(16).padStart(3, "0").toUpperCase()}`;
const total = (counts) => Object.values(counts).reduce((all, one) => all + one, 0);
