/** The connection to the panel's server: the latest status, pictures of traces, orders; it comes back by itself. */

const AGAIN = 1000; // ms until another attempt
const STALE = 1500; // ms without a word
const DEAD = 5000; // ms without a word, after which the connection is given up: a lost network closes none

export class Link {
  constructor() {
    // Kept over a reload alone: a tab that is duplicated has a copy of what lies there, and is another page.
    this.page = sessionStorage.getItem("page") ?? crypto.getRandomValues(new Uint32Array(4)).join("-");
    sessionStorage.removeItem("page");
    window.addEventListener("pagehide", () => sessionStorage.setItem("page", this.page));
    this.status = null;
    this.heard = null; // when, as the browser's clock says
    this.traces = new Map();
    this.listeners = new Set();
  }

  /** Follow the rig from now on. */
  begin() {
    this.open();
    setInterval(() => {
      if (Date.now() - Math.max(this.opened, this.heard) > DEAD) this.open();
      this.listeners.forEach((tell) => tell());
    }, 500);
  }

  open() {
    this.opened = Date.now();
    this.giveUp();
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/api/stream?page=${this.page}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => this.want();
    this.socket.onmessage = ({ data }) => {
      this.heard = Date.now();
      if (typeof data === "string") {
        this.status = JSON.parse(data);
        this.listeners.forEach((tell) => tell());
      } else {
        this.picture(data);
      }
    };
    this.socket.onclose = () => (this.again = setTimeout(() => this.open(), AGAIN));
  }

  giveUp() {
    clearTimeout(this.again);
    if (!this.socket) return;
    this.socket.onopen = this.socket.onmessage = this.socket.onclose = null;
    this.socket.close();
  }

  /** Whether nothing has come for a while. */
  get stale() {
    return this.heard === null || Date.now() - this.heard > STALE;
  }

  /** Call `tell()` whenever there is news, and twice a second. Returns what ends it. */
  listen(tell) {
    this.listeners.add(tell);
    if (this.status) tell();
    return () => this.listeners.delete(tell);
  }

  /** Ask for pictures: `take(first, width, fresh, low, high)`, arrays of Float32Array by signal. Returns what ends it. */
  trace(signals, span, columns, take) {
    const id = Math.max(0, ...this.traces.keys()) + 1;
    this.traces.set(id, { signals, span, columns, take });
    this.want();
    return () => {
      this.traces.delete(id);
      this.want();
    };
  }

  want() {
    if (this.socket.readyState !== WebSocket.OPEN) return;
    const traces = [...this.traces].map(([id, { signals, span, columns }]) => ({ id, signals, span, columns }));
    this.socket.send(JSON.stringify({ traces }));
  }

  picture(data) {
    const view = new DataView(data);
    const [id, signals, count, fresh] = [0, 4, 8, 12].map((at) => view.getUint32(at, true));
    const wanted = this.traces.get(id);
    if (!wanted || wanted.signals.length !== signals) return; // of what was wanted before
    const all = new Float32Array(data, 32);
    const part = (k) => all.subarray(k * count, (k + 1) * count);
    const low = wanted.signals.map((_, k) => part(k));
    const high = wanted.signals.map((_, k) => part(signals + k));
    wanted.take(view.getFloat64(16, true), view.getFloat64(24, true), fresh === 1, low, high);
  }

  /** Give an order as this page; throws an Error with the server's words if it is refused. */
  order(path, body = {}) {
    return window.astb.order(path, body, { "X-ASTB-Page": this.page });
  }
}
