/** Numbers as a report packs them (16 bits each, in steps of a range, deflated, in base 64): a function from where a series lies to its numbers. */
window.unpacked = async (packed) => {
  "use strict";
  const GAP = 65535, STEPS = 65534;
  const deflated = new Blob([Uint8Array.from(atob(packed.trim()), (c) => c.charCodeAt(0))]);
  const inflated = deflated.stream().pipeThrough(new DecompressionStream("deflate"));
  const words = new Uint16Array(await new Response(inflated).arrayBuffer());
  const kept = new Map();
  return ([start, count, low, high]) => {
    if (!kept.has(start)) {
      const of = (word) => (word === GAP ? null : low + (word / STEPS) * (high - low));
      kept.set(start, Array.from(words.subarray(start, start + count), of));
    }
    return kept.get(start);
  };
};
