// SPDX-License-Identifier: Apache-2.0
// Curves of the last images, on a ground that tells the status of each.

const KEPT = 240;

export class Chart {
  constructor(canvas, { low = null, high = null, zero = false, peaks = true }) {
    Object.assign(this, { canvas, low, high, zero, peaks, values: [], states: [] });
  }

  add(value, status) {
    this.values.push(Number.isFinite(value) ? value : null);
    this.states.push(status);
    if (this.values.length > KEPT) {
      this.values.shift();
      this.states.shift();
    }
  }

  clear() {
    this.values = [];
    this.states = [];
  }

  // The largest value but for rare peaks, such as the first look, beside which nothing else could be seen.
  calm(known) {
    if (this.peaks || !known.length) return Math.max(...known);
    const sorted = [...known].sort((a, b) => a - b);
    return 1.25 * sorted[Math.floor(0.95 * (sorted.length - 1))];
  }

  draw(style) {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(this.canvas.clientWidth * ratio);
    const height = Math.round(this.canvas.clientHeight * ratio);
    if (!width || !height) return;
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    const g = this.canvas.getContext("2d");
    g.clearRect(0, 0, width, height);
    const known = this.values.filter((v) => v !== null);
    let low = this.low ?? Math.min(...known, this.zero ? 0 : Infinity);
    let high = this.high ?? Math.max(this.calm(known), this.zero ? 0 : -Infinity);
    if (!(high > low)) [low, high] = [(Number.isFinite(low) ? low : 0) - 1, (Number.isFinite(high) ? high : 0) + 1];
    const room = 0.08 * (high - low);
    const x = (i) => (i / (KEPT - 1)) * width;
    const y = (v) => height - ((v - low + room) / (high - low + 2 * room)) * height;
    const step = width / (KEPT - 1);
    const from = KEPT - this.values.length;
    for (let i = 0; i < this.states.length; ) {
      let end = i + 1;
      while (end < this.states.length && this.states[end] === this.states[i]) end += 1;
      g.fillStyle = style(`--${this.states[i]}-soft`);
      g.fillRect(x(from + i) - step / 2, 0, (end - i) * step + 1, height);
      i = end;
    }
    g.strokeStyle = style("--rule");
    g.lineWidth = ratio;
    if (this.zero && low < 0) {
      g.beginPath();
      g.moveTo(0, y(0));
      g.lineTo(width, y(0));
      g.stroke();
    }
    g.strokeRect(0.5, 0.5, width - 1, height - 1);
    g.strokeStyle = style("--ink");
    g.lineWidth = 1.6 * ratio;
    g.lineJoin = "round";
    g.beginPath();
    let down = false;
    this.values.forEach((value, i) => {
      if (value === null) down = false;
      else {
        if (down) g.lineTo(x(from + i), Math.max(y(value), 0));
        else g.moveTo(x(from + i), Math.max(y(value), 0));
        down = true;
      }
    });
    g.stroke();
  }
}
