// Panels: stacked diagrams over one axis, drawn on a canvas; the look of an oscilloscope, in the page's theme.
//
// new Panels(host, {x, panels, live, label}); host: an element with a height. Every series is one of
//   {kind: "line", x, y}   {kind: "band", x, low, high}   {kind: "points", x, y}   {kind: "extremes", x, low, high}
// and has a name, a colour (a CSS variable of theme.css without its dashes), a width and a dash.
// Wheel or + and − zoom, dragging selects, double click or Home shows all, arrows move the cursor.
(() => {
  "use strict";

  const FONT = '12px Roboto, "Segoe UI", "Helvetica Neue", Arial, sans-serif';
  const GAP = 8, TITLE = 20, BOTTOM = 36, RIGHT = 12;

  /** Round steps (1, 2 or 5 times a power of ten) that divide a range into about `count` parts. */
  function ticks(low, high, count) {
    const rough = (high - low) / Math.max(count, 1);
    if (!(rough > 0) || !isFinite(rough)) return [];
    const power = Math.pow(10, Math.floor(Math.log10(rough)));
    const step = [1, 2, 5, 10].find((n) => n * power >= rough * 0.999) * power;
    const found = [];
    for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n++) found.push(n * step);
    return found.length < 2 && count < 16 ? ticks(low, high, 2 * count) : found; // one alone tells no scale
  }

  /** Powers of ten, and 2 and 5 times them where there are few. */
  function logTicks(low, high) {
    const found = [], few = Math.log10(high / low) < 3;
    for (let e = Math.floor(Math.log10(low)); e <= Math.ceil(Math.log10(high)); e++)
      for (const n of few ? [1, 2, 5] : [1]) {
        const value = n * Math.pow(10, e);
        if (value >= low * 0.999 && value <= high * 1.001) found.push(value);
      }
    return found;
  }

  /** A number as people read it: digits that fit the step of its axis. */
  function text(value, step) {
    if (!isFinite(value)) return "–";
    const size = Math.max(Math.abs(value), Math.abs(step || 0));
    if (size !== 0 && (size >= 1e5 || size < 1e-4)) {
      const digits = step ? Math.max(0, Math.floor(Math.log10(size)) - Math.floor(Math.log10(step))) : 2;
      return value === 0 ? "0" : value.toExponential(Math.min(digits, 3)).replace("-", "−").replace("e+", "e");
    }
    const digits = step ? Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) : Math.max(0, 3 - Math.floor(Math.log10(size || 1)));
    return value.toFixed(Math.min(digits, 6)).replace("-", "−");
  }

  /** The index of the value next to `x` in increasing values; −1 where there are none. */
  function nearest(xs, x) {
    let low = 0, high = xs.length - 1;
    if (high < 0) return -1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (xs[middle] <= x) low = middle; else high = middle;
    }
    return Math.abs(xs[low] - x) <= Math.abs(xs[high] - x) ? low : high;
  }

  class Panels {
    constructor(host, options) {
      this.host = host;
      this.canvas = document.createElement("canvas");
      this.canvas.tabIndex = 0;
      this.canvas.setAttribute("role", "img");
      host.classList.add("panels");
      host.replaceChildren(this.canvas);
      this.view = null; // [low, high] of x where zoomed
      this.cursor = null;
      this.drag = null;
      this.set(options);
      this.observer = new ResizeObserver(() => this.ask());
      this.observer.observe(host);
      this.onTheme = () => { this.colours = null; this.ask(); };
      document.addEventListener("schwung-theme", this.onTheme);
      this.listen();
    }

    set(options) {
      const label = options.label || "diagram";
      if (this.label !== label) this.canvas.setAttribute("aria-label", (this.label = label)); // not 30 times a second
      this.options = options;
      this.ask();
    }

    remove() {
      this.observer.disconnect();
      document.removeEventListener("schwung-theme", this.onTheme);
    }

    /** Draw with the next frame of the screen, however often this is asked for. */
    ask() {
      if (this.asked) return;
      this.asked = true;
      requestAnimationFrame(() => { this.asked = false; this.draw(); });
    }

    colour(name) {
      this.colours ||= {};
      return (this.colours[name] ||= getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim() || "#888");
    }

    extent() {
      if (this.view) return this.view;
      if (this.options.x.range) return this.options.x.range;
      let low = Infinity, high = -Infinity;
      for (const panel of this.options.panels) for (const s of panel.series) {
        if (!s.x.length) continue;
        low = Math.min(low, s.x[0], s.x[s.x.length - 1]);
        high = Math.max(high, s.x[0], s.x[s.x.length - 1]);
      }
      if (!(high > low)) return isFinite(low) ? [low - 0.5, low + 0.5] : [0, 1];
      if (this.options.x.log) return [low, high];
      const margin = 0.01 * (high - low);
      return [low - margin, high + margin];
    }

    reach(panel, [from, to]) {
      if (panel.range) return panel.range;
      let low = Infinity, high = -Infinity;
      for (const s of panel.series) {
        const lows = s.low || s.y, highs = s.high || s.y;
        for (let i = 0; i < s.x.length; i++) {
          if (s.x[i] < from || s.x[i] > to || lows[i] === null || highs[i] === null) continue;
          if (lows[i] < low) low = lows[i];
          if (highs[i] > high) high = highs[i];
        }
      }
      for (const line of panel.lines || []) if (line.always) { low = Math.min(low, line.value); high = Math.max(high, line.value); }
      if (!(high >= low)) return [0, 1];
      if (panel.log) return [low, high].map((v, i) => (v > 0 ? v * (i ? 1.25 : 0.8) : 1e-6));
      if (panel.zero) low = Math.min(low, 0);
      const least = panel.least || 1e-9 * Math.max(1, Math.abs(high));
      if (high - low < least) { const middle = (low + high) / 2; low = middle - least / 2; high = middle + least / 2; }
      const margin = 0.07 * (high - low);
      return [panel.zero && low === 0 ? 0 : low - margin, high + margin];
    }

    draw() {
      const width = this.host.clientWidth, height = this.host.clientHeight;
      if (!width || !height) return;
      const scale = window.devicePixelRatio || 1;
      if (this.canvas.width !== Math.round(width * scale) || this.canvas.height !== Math.round(height * scale)) {
        this.canvas.width = Math.round(width * scale);
        this.canvas.height = Math.round(height * scale);
        this.canvas.style.width = width + "px";
        this.canvas.style.height = height + "px";
      }
      const c = this.canvas.getContext("2d");
      c.setTransform(scale, 0, 0, scale, 0, 0);
      c.clearRect(0, 0, width, height);
      c.font = FONT;
      c.textBaseline = "middle";
      const panels = this.options.panels, extent = this.extent();
      const reaches = panels.map((panel) => this.reach(panel, extent));
      const shares = panels.map((panel) => panel.share || 1), all = shares.reduce((a, b) => a + b, 0);
      const room = height - BOTTOM - panels.length * TITLE - (panels.length - 1) * GAP;
      const marks = panels.map((panel, n) =>
        panel.log ? logTicks(...reaches[n]) : ticks(...reaches[n], Math.max(3, Math.min(6, (room * shares[n]) / all / 30))));
      const steps = marks.map((m) => (m.length > 1 ? m[1] - m[0] : 1));
      const widest = Math.max(...marks.flatMap((m, n) => m.map((v) => c.measureText(panels[n].log ? text(v) : text(v, steps[n])).width)), 28);
      const left = Math.ceil(widest) + 14;
      this.area = { left, right: width - RIGHT, extent };
      const log = this.options.x.log;
      const at = log
        ? (x) => left + (Math.log(x / extent[0]) / Math.log(extent[1] / extent[0])) * (width - RIGHT - left)
        : (x) => left + ((x - extent[0]) / (extent[1] - extent[0])) * (width - RIGHT - left);
      const xMarks = log ? logTicks(...extent) : ticks(...extent, Math.max(2, Math.min(10, (width - left) / 90)));
      let top = 0;
      panels.forEach((panel, n) => {
        const box = { left, right: width - RIGHT, top: top + TITLE, bottom: top + TITLE + (room * shares[n]) / all };
        this.panel(c, panel, box, at, reaches[n], marks[n], steps[n], xMarks);
        top = box.bottom + GAP;
      });
      const bottom = top - GAP, xStep = xMarks.length > 1 ? xMarks[1] - xMarks[0] : 1;
      c.fillStyle = this.colour("muted");
      c.textAlign = "center";
      for (const mark of xMarks) c.fillText(log ? text(mark).replace(/\.?0+$/, "") : text(mark, xStep), at(mark), bottom + 12);
      c.textAlign = "right";
      c.fillText(this.options.x.label, width - RIGHT, bottom + 28);
      this.drawCursor(c, at, bottom, width);
      if (this.drag && Math.abs(this.drag.to - this.drag.from) > 3) {
        c.fillStyle = this.colour("estimate");
        c.globalAlpha = 0.15;
        c.fillRect(Math.min(this.drag.from, this.drag.to), TITLE, Math.abs(this.drag.to - this.drag.from), bottom - TITLE);
        c.globalAlpha = 1;
      }
    }

    panel(c, panel, box, at, reach, marks, step, xMarks) {
      const height = box.bottom - box.top;
      const up = panel.log
        ? (y) => box.bottom - (Math.log(Math.max(y, 1e-12) / reach[0]) / Math.log(reach[1] / reach[0])) * height
        : (y) => box.bottom - ((y - reach[0]) / (reach[1] - reach[0])) * height;
      c.lineWidth = 1;
      c.strokeStyle = this.colour("grid");
      c.beginPath();
      for (const mark of xMarks) { const x = Math.round(at(mark)) + 0.5; c.moveTo(x, box.top); c.lineTo(x, box.bottom); }
      for (const mark of marks) { const y = Math.round(up(mark)) + 0.5; c.moveTo(box.left, y); c.lineTo(box.right, y); }
      c.stroke();
      c.fillStyle = this.colour("muted");
      c.textAlign = "right";
      for (const mark of marks) {
        const y = up(mark);
        if (y > box.top - 2 && y < box.bottom + 2) c.fillText(panel.log ? text(mark).replace(/\.?0+$/, "") : text(mark, step), box.left - 7, Math.min(Math.max(y, box.top + 5), box.bottom - 4));
      }
      c.save();
      c.beginPath();
      c.rect(box.left, box.top, box.right - box.left, height);
      c.clip();
      for (const line of panel.lines || []) this.limit(c, line, box, up);
      for (const s of panel.series) this.series(c, s, at, up, box);
      c.restore();
      c.strokeStyle = this.colour("edge");
      c.strokeRect(box.left + 0.5, box.top + 0.5, box.right - box.left - 1, height - 1);
      this.heading(c, panel, box);
    }

    heading(c, panel, box) {
      c.textAlign = "left";
      c.font = "600 " + FONT;
      c.fillStyle = this.colour("ink");
      let x = box.left;
      const y = box.top - 10;
      c.fillText(panel.title, x, y);
      x += c.measureText(panel.title).width + 14;
      c.font = FONT;
      for (const s of panel.series) {
        if (!s.name) continue;
        let shown = s.name;
        if (this.cursor !== null && s.x.length) {
          const i = nearest(s.x, this.cursor);
          shown += s.y ? " " + text(s.y[i]) : s.kind === "extremes" ? text((s.low[i] + s.high[i]) / 2) : "";
        } else if (s.kind === "extremes") {
          const i = s.x.length - 1;
          shown += i >= 0 ? text((s.low[i] + s.high[i]) / 2) : "–";
        }
        const wide = c.measureText(shown).width + 18;
        if (x + wide > box.right) break;
        c.strokeStyle = c.fillStyle = this.colour(s.colour);
        c.lineWidth = s.kind === "band" ? 8 : 2.5;
        c.globalAlpha = s.kind === "band" ? 0.35 : 1;
        c.setLineDash(s.dash || []);
        c.beginPath(); c.moveTo(x, y); c.lineTo(x + 12, y); c.stroke();
        c.setLineDash([]);
        c.globalAlpha = 1;
        c.fillStyle = this.colour("ink");
        c.fillText(shown, x + 17, y);
        x += wide + 14;
      }
    }

    limit(c, line, box, up) {
      const y = Math.round(up(line.value)) + 0.5;
      c.strokeStyle = c.fillStyle = this.colour(line.colour || "unusable");
      c.lineWidth = 1.25;
      c.setLineDash([7, 4]);
      c.beginPath(); c.moveTo(box.left, y); c.lineTo(box.right, y); c.stroke();
      c.setLineDash([]);
      if (line.text) {
        c.textAlign = "right";
        c.fillText(line.text, box.right - 6, y + (y - box.top < 18 ? 9 : -8));
      }
    }

    series(c, s, at, up, box) {
      const n = s.x.length;
      if (!n) return;
      c.strokeStyle = c.fillStyle = this.colour(s.colour);
      c.lineWidth = s.width || 1.6;
      c.setLineDash(s.dash || []);
      c.globalAlpha = s.alpha || 1;
      c.lineJoin = "round";
      if (s.kind === "band") {
        c.globalAlpha = s.alpha || 0.2;
        for (let begin = 0; begin < n; begin++) { // piece by piece: null is a gap
          if (s.low[begin] === null) continue;
          let end = begin;
          while (end + 1 < n && s.low[end + 1] !== null) end++;
          c.beginPath();
          for (let i = begin; i <= end; i++) c.lineTo(at(s.x[i]), up(s.high[i]));
          for (let i = end; i >= begin; i--) c.lineTo(at(s.x[i]), up(s.low[i]));
          c.fill();
          begin = end;
        }
      } else if (s.kind === "points") {
        for (let i = 0; i < n; i++) { c.beginPath(); c.arc(at(s.x[i]), up(s.y[i]), s.size || 2, 0, 7); c.fill(); }
      } else if (s.kind === "extremes") {
        this.extremes(c, s, at, up, box);
      } else {
        c.beginPath();
        let pen = false;
        for (let i = 0; i < n; i++) {
          const y = s.y[i];
          if (y === null || !isFinite(y)) { pen = false; continue; }
          if (pen) c.lineTo(at(s.x[i]), up(y)); else c.moveTo(at(s.x[i]), up(y));
          pen = true;
        }
        c.stroke();
      }
      c.setLineDash([]);
      c.globalAlpha = 1;
    }

    /** Smallest and largest of every bin, put together to one upright per column of the screen: no peak is lost. All of a
        trace is one path of rectangles on whole pixels, which is drawn in a quarter of the time that lines take, and an
        upright reaches as far as its neighbour, so that there is no gap in a steep place. */
    extremes(c, s, at, up, box) {
      const wide = s.width || 1.4;
      c.beginPath();
      let column = -1e9, low = 0, high = 0, above = null, below = null, before = 0;
      const flush = () => {
        if (column < box.left - 4) return;
        const joined = above !== null, top = Math.round(up(high)), bottom = Math.round(up(low));
        const from = joined ? Math.min(top, below) : top, to = joined ? Math.max(bottom, above) : bottom;
        if (joined && column - before > 2) { // zoomed in: what lies between two is slanted
          c.moveTo(before, above - wide / 2);
          for (const [x, y] of [[column, top - wide / 2], [column, bottom + wide / 2], [before, below + wide / 2]]) c.lineTo(x, y);
          c.closePath();
        } else c.rect(joined ? before + 1 : column, from - wide / 2, joined ? column - before : 1, to - from + wide);
        above = top; below = bottom; before = column;
      };
      for (let i = 0; i < s.x.length; i++) {
        if (!isFinite(s.low[i])) { flush(); column = -1e9; above = below = null; continue; }
        const x = Math.round(at(s.x[i]));
        if (x === column) { if (s.low[i] < low) low = s.low[i]; if (s.high[i] > high) high = s.high[i]; continue; }
        flush();
        column = x; low = s.low[i]; high = s.high[i];
      }
      flush();
      c.fill();
    }

    drawCursor(c, at, bottom, width) {
      if (this.cursor === null) return;
      const x = Math.round(at(this.cursor)) + 0.5;
      if (x < this.area.left || x > this.area.right) return;
      c.strokeStyle = this.colour("ink");
      c.lineWidth = 1;
      c.setLineDash([3, 3]);
      c.beginPath(); c.moveTo(x, TITLE); c.lineTo(x, bottom); c.stroke();
      c.setLineDash([]);
      c.textAlign = x > width / 2 ? "right" : "left";
      c.fillStyle = this.colour("ink");
      c.fillText(text(this.cursor) + " " + (this.options.x.unit || ""), x + (x > width / 2 ? -6 : 6), bottom + 28);
    }

    valueAt(pixel) {
      const { left, right, extent } = this.area, share = (pixel - left) / (right - left);
      return this.options.x.log ? extent[0] * Math.pow(extent[1] / extent[0], share) : extent[0] + share * (extent[1] - extent[0]);
    }

    zoom(factor, pixel) {
      const { left, right, extent } = this.area;
      const share = (Math.min(Math.max(pixel, left), right) - left) / (right - left);
      const [a, b] = this.options.x.log ? extent.map(Math.log) : extent;
      const middle = a + share * (b - a), next = [middle - (middle - a) * factor, middle + (b - middle) * factor];
      this.view = this.options.x.log ? next.map(Math.exp) : next;
      this.host.dispatchEvent(new CustomEvent("zoomed"));
      this.ask();
    }

    all() { this.view = null; this.host.dispatchEvent(new CustomEvent("all")); this.ask(); }

    listen() {
      const canvas = this.canvas;
      canvas.addEventListener("pointermove", (e) => {
        if (!this.area) return;
        this.cursor = e.offsetX >= this.area.left && e.offsetX <= this.area.right ? this.valueAt(e.offsetX) : null;
        if (this.drag) this.drag.to = e.offsetX;
        this.ask();
      });
      canvas.addEventListener("pointerleave", () => { this.cursor = null; this.ask(); });
      canvas.addEventListener("pointerdown", (e) => { this.drag = { from: e.offsetX, to: e.offsetX }; if (e.pointerType !== "touch") canvas.setPointerCapture(e.pointerId); });
      canvas.addEventListener("pointerup", (e) => {
        const drag = this.drag;
        this.drag = null;
        if (drag && e.pointerType !== "touch" && Math.abs(drag.to - drag.from) > 8) {
          this.view = [this.valueAt(Math.min(drag.from, drag.to)), this.valueAt(Math.max(drag.from, drag.to))];
          this.host.dispatchEvent(new CustomEvent("zoomed"));
        }
        this.ask();
      });
      canvas.addEventListener("pointercancel", () => { this.drag = null; this.ask(); });
      canvas.addEventListener("dblclick", () => this.all());
      canvas.addEventListener("wheel", (e) => {
        if (!e.ctrlKey && !e.shiftKey && document.activeElement !== canvas) return; // the page scrolls, until it is chosen
        e.preventDefault();
        this.zoom(e.deltaY > 0 ? 1.25 : 0.8, e.offsetX);
      }, { passive: false });
      canvas.addEventListener("keydown", (e) => {
        if (!this.area) return;
        const { left, right, extent } = this.area, middle = (left + right) / 2;
        if (e.key === "+" || e.key === "=") this.zoom(0.7, middle);
        else if (e.key === "-") this.zoom(1.4, middle);
        else if (e.key === "Home") this.all();
        else if (e.key === "ArrowLeft" || e.key === "ArrowRight") {
          const step = (extent[1] - extent[0]) * (e.shiftKey ? 0.05 : 0.005) * (e.key === "ArrowLeft" ? -1 : 1);
          this.cursor = Math.min(Math.max((this.cursor ?? this.valueAt(middle)) + step, extent[0]), extent[1]);
          this.ask();
        } else return;
        e.preventDefault();
      });
    }
  }

  window.Schwung = Object.assign(window.Schwung || {}, { Panels, numberText: text });
})();
