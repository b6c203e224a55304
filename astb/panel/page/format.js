/** Numbers as the reports print them: a true minus sign, thin spaces between thousands, a dash where there is none. */

export function fixed(value, decimals) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const [whole, fraction] = Math.abs(value).toFixed(decimals).split(".");
  const grouped = whole.replace(/\B(?=(\d{3})+$)/g, "\u2009");
  const zero = Number(whole) === 0 && !Number(fraction ?? 0);
  return (value < 0 && !zero ? "\u2212" : "") + grouped + (fraction ? "." + fraction : "");
}

/** A round number without the decimals that it does not need. */
export const plain = (value) => fixed(value, 3).replace(/\.?0+$/, "");

/** The labels of an axis whose marks are `step` apart: all with the decimals that the step needs, and no more. */
export function ticks(values, step) {
  let decimals = 0;
  while (decimals < 6 && Math.abs(step * 10 ** decimals - Math.round(step * 10 ** decimals)) > 1e-6) decimals += 1;
  return values.map((value) => (value === null ? "" : fixed(value, decimals)));
}

/** A time of day by the clock on the wall here, of ms since 1970. */
export const clock = (ms) => new Date(ms).toLocaleTimeString([], { hour12: false });

/** A duration in s as people say it: 42 s, 3:05 min, 1:02:00 h. */
export function duration(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  if (whole < 60) return `${whole}\u2009s`;
  const two = (n) => String(n).padStart(2, "0");
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  return h ? `${h}:${two(m)}:${two(s)}\u2009h` : `${m}:${two(s)}\u2009min`;
}

/** An element with attributes and children, texts as texts. */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}
