/** What the tab of the browser says, for whoever has another one open: what waits for him first, then how far a run is. */
export function tabTitle({ rig, runs }, stale, fault, name) {
  const { run } = rig;
  const told = stale || rig.link ? "⚠ not heard"
    : run?.question ? `❓ ${run.plan} asks`
    : fault ? `⚠ ${rig.state.replaceAll("_", " ")}`
    : run?.held ? `⏸ ${run.plan} is held`
    : run ? `${Math.floor(100 * run.fraction)} % ${run.plan}`
    : runs.last?.verdict ? `${runs.last.verdict}: ${runs.last.plan}`
    : "";
  return [told, name, "ASTB"].filter(Boolean).join(" – ");
}
