/** Title of the browser tab: first what needs an action, then the progress of a run. */
export function tabTitle({ rig, runs }, stale, fault, name) {
  const { run } = rig;
  const told = stale || rig.link ? "⚠ no data"
    : run?.question ? `❓ ${run.plan}: answer needed`
    : fault ? `⚠ ${rig.state.replaceAll("_", " ")}`
    : run?.held ? `⏸ ${run.plan} is held`
    : run ? `${Math.floor(100 * run.fraction)} % ${run.plan}`
    : runs.last?.verdict ? `${runs.last.verdict}: ${runs.last.plan}`
    : "";
  return [told, name, "ASTB"].filter(Boolean).join(" – ");
}
