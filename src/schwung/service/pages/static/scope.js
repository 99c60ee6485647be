// The live scope: smallest and largest values per column from the service's binary frames, drawn 30 times a second.
//
// One frame (little endian): u32 what (1 columns, 2 begin anew), u32 columns n, u32 channels k, u32 samples behind,
// f64 time of the first column (s), f64 width of a column (s), then per channel n lows and n highs (f32); NaN: lost.
// The page asks with {"window_s", "columns"}; the service answers with what it has of that window, and goes on.
const WINDOWS = [["0.5 s", 0.5], ["2 s", 2], ["5 s", 5], ["10 s", 10], ["30 s", 30], ["120 s", 120]];
const FRAME_MS = 1000 / 30;

class Columns {
  constructor(channels) {
    this.size = 4096; this.n = 0;
    this.time = new Float64Array(this.size);
    this.low = Array.from({ length: channels }, () => new Float32Array(this.size));
    this.high = Array.from({ length: channels }, () => new Float32Array(this.size));
  }
  add(time, step, lows, highs, n) {
    if (this.n + n > this.size) this.drop(Math.max(this.n + n - this.size, this.size >> 1));
    for (let i = 0; i < n; i++) this.time[this.n + i] = time + i * step;
    lows.forEach((values, k) => { this.low[k].set(values, this.n); this.high[k].set(highs[k], this.n); });
    this.n += n;
  }
  drop(count) {
    count = Math.min(count, this.n);
    this.time.copyWithin(0, count, this.n);
    for (const part of [...this.low, ...this.high]) part.copyWithin(0, count, this.n);
    this.n -= count;
  }
}

export default {
  template: `<div class="sw-scope">
    <div class="bar">
      <span class="sw-seg" role="group" aria-label="time shown">
        <button v-for="[name, s] in windows" type="button" :aria-pressed="String(s === window_s)" @click="show(s)">{{ name }}</button>
      </span>
      <button type="button" class="sw-button small" :aria-pressed="String(frozen)" @click="freeze">{{ frozen ? 'Go on' : 'Hold' }}</button>
      <span class="spring"></span>
      <span class="state" role="status">{{ state }}</span>
    </div>
    <div class="plot"><div ref="plot" :style="{height: height + 'px'}"></div></div>
  </div>`,
  props: { url: String, traces: Array, height: { type: Number, default: 420 }, initial_s: { type: Number, default: 5 } },
  data() { return { windows: WINDOWS, window_s: this.initial_s, frozen: false, state: "waiting for the drive" }; },
  mounted() {
    this.columns = new Columns(this.traces.length);
    this.drawn = this.behind = this.received = 0;
    this.fresh = false;
    this.plot = new window.Schwung.Panels(this.$refs.plot, this.options());
    this.$refs.plot.addEventListener("zoomed", () => { this.frozen = true; });
    this.$refs.plot.addEventListener("all", () => { this.frozen = false; this.fresh = true; });
    this.open();
    this.last = 0;
    const step = (now) => {
      this.raf = requestAnimationFrame(step);
      if (!this.fresh || this.frozen) return;
      if (now - this.last < FRAME_MS - 4) return; // 30 a second are enough for the eye, and spare the tablet
      this.last = now; // of a picture: where nothing had come, the next one need not wait
      this.redraw();
    };
    this.raf = requestAnimationFrame(step);
    this.counting = setInterval(() => this.count(), 1000);
  },
  beforeUnmount() {
    cancelAnimationFrame(this.raf);
    clearInterval(this.counting);
    clearTimeout(this.again);
    this.ended = true;
    if (this.socket) this.socket.close();
    this.plot.remove();
  },
  methods: {
    open() {
      const address = new URL(this.url, location.href);
      address.protocol = address.protocol.replace("http", "ws");
      const socket = (this.socket = new WebSocket(address));
      socket.binaryType = "arraybuffer";
      socket.onopen = () => { this.ask(); this.state = "connected"; };
      socket.onmessage = (e) => { if (e.data instanceof ArrayBuffer) this.take(e.data); };
      socket.onclose = () => { if (!this.ended) { this.state = "connection lost, trying again"; this.again = setTimeout(() => this.open(), 1000); } };
    },
    ask() {
      const columns = Math.max(200, Math.min(2000, Math.round(this.$refs.plot.clientWidth || 900)));
      if (this.socket.readyState === 1) this.socket.send(JSON.stringify({ window_s: this.window_s, columns }));
    },
    show(seconds) { this.window_s = seconds; this.frozen = false; this.plot.view = null; this.ask(); },
    freeze() { this.frozen = !this.frozen; if (!this.frozen) { this.plot.view = null; this.fresh = true; } },
    take(buffer) {
      const head = new DataView(buffer), what = head.getUint32(0, true), n = head.getUint32(4, true), k = head.getUint32(8, true);
      if (what === 2 && !this.frozen) this.columns = new Columns(this.traces.length);
      if (this.frozen || k !== this.traces.length) return;
      this.behind = head.getUint32(12, true);
      const lows = [], highs = [];
      for (let i = 0; i < k; i++) {
        lows.push(new Float32Array(buffer, 32 + 8 * i * n, n));
        highs.push(new Float32Array(buffer, 32 + 8 * i * n + 4 * n, n));
      }
      this.columns.add(head.getFloat64(16, true), head.getFloat64(24, true), lows, highs, n);
      this.received += n;
      this.fresh = true;
    },
    options() {
      const c = this.columns, x = c.time.subarray(0, c.n);
      const start = c.n ? Math.max(c.time[0], c.time[c.n - 1] - this.window_s) : 0; // filled from the left, then it moves
      return {
        label: "live scope: " + this.traces.map((t) => t.name).join(", "),
        x: { label: "Time of the drive, s", unit: "s", range: [start, start + this.window_s] },
        panels: this.traces.map((t, i) => ({
          title: t.name + ", " + t.unit, least: t.least, lines: t.lines,
          series: [{ name: " ", kind: "extremes", colour: t.colour, x, low: c.low[i].subarray(0, c.n), high: c.high[i].subarray(0, c.n) }],
        })),
      };
    },
    redraw() { this.fresh = false; this.plot.set(this.options()); this.drawn += 1; },
    count() {
      if (this.socket.readyState !== 1) return;
      const held = this.frozen ? "held" : this.drawn ? this.drawn + (this.drawn === 1 ? " frame/s" : " frames/s") : "no new samples";
      this.state = held + (this.behind ? " · " + this.behind + " samples behind" : "");
      this.$el.dataset.frames = this.drawn;
      this.drawn = this.received = 0;
    },
  },
};
