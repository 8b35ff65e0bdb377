// Strip charts of the last minute, and the sketch of the track.

import { prepare } from "/section.js";

const FONT = '600 12px system-ui, "DejaVu Sans", sans-serif';

/** A strip chart: `lines` are the columns of a moment and the names of their colours. */
export class Strip {
  constructor(canvas, lines, { symmetric = false, least = 1, seconds = 60 } = {}) {
    Object.assign(this, { canvas, lines, symmetric, least, seconds });
  }

  draw(moments, colours) {
    const { context: c, width, height } = prepare(this.canvas);
    if (width < 20 || height < 20 || moments.length < 2) return;
    const end = moments[moments.length - 1][0];
    const first = Math.max(0, moments.findLastIndex((moment) => moment[0] < end - this.seconds));
    let low = Infinity, high = -Infinity;
    for (let i = first; i < moments.length; i++) {
      for (const [column] of this.lines) {
        const value = moments[i][column];
        if (Number.isNaN(value)) continue;
        low = Math.min(low, value);
        high = Math.max(high, value);
      }
    }
    if (low > high) { low = -1; high = 1; }
    const half = Math.max(this.least, (high - low) * 0.55);
    let middle = (low + high) / 2;
    if (this.symmetric) { middle = 0; }
    const reach = this.symmetric ? Math.max(this.least, Math.abs(low), Math.abs(high)) * 1.1 : half;
    // Limits that stay while the data stay within them.
    if (!this.limits || low < this.limits[0] || high > this.limits[1] || reach < (this.limits[1] - this.limits[0]) / 5) {
      this.limits = [middle - reach, middle + reach];
    }
    const [bottom, top] = this.limits;
    const right = width - 46;
    const x = (time) => right - ((end - time) / this.seconds) * right;
    const y = (value) => 4 + ((top - value) / (top - bottom)) * (height - 18);
    c.font = FONT;
    c.fillStyle = colours.dim;
    c.strokeStyle = colours.grid;
    c.lineWidth = 1;
    const step = nice((top - bottom) / 3);
    for (let value = Math.ceil(bottom / step) * step; value <= top; value += step) {
      c.beginPath(); c.moveTo(0, y(value)); c.lineTo(right, y(value)); c.stroke();
      if (y(value) > 10) c.fillText(`${String(Number(value.toFixed(2))).replace("-", "−")}°`, right + 5, y(value) + 4);
    }
    const every = right < 260 ? this.seconds / 2 : this.seconds / 4;
    for (let back = 0; back <= this.seconds; back += every) {
      c.textAlign = back === 0 ? "right" : back === this.seconds ? "left" : "center";
      c.fillText(back === 0 ? "now" : `−${back} s`, x(end - back), height - 2);
    }
    c.textAlign = "left";
    c.lineWidth = 2;
    c.lineJoin = "round";
    for (const [column, colour] of this.lines) {
      c.strokeStyle = colours[colour];
      c.beginPath();
      let pen = false;
      for (let i = first; i < moments.length; i++) {
        const value = moments[i][column];
        if (Number.isNaN(value)) { pen = false; continue; }
        if (pen) c.lineTo(x(moments[i][0]), y(value)); else c.moveTo(x(moments[i][0]), y(value));
        pen = true;
      }
      c.stroke();
    }
  }
}

/** 1, 2 or 5 times a power of ten, near this. */
function nice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  const rest = value / power;
  return power * (rest < 1.5 ? 1 : rest < 3.5 ? 2 : rest < 7.5 ? 5 : 10);
}

/** The track: knots are east, north and station in metres. */
export class TrackView {
  constructor(canvas) { this.canvas = canvas; }

  draw(knots, motion, markers, colours) {
    const { context: c, width, height } = prepare(this.canvas);
    if (width < 40 || height < 40) return;
    const here = motion?.place_m;
    if (knots.length < 2 && !here) {
      c.font = FONT; c.fillStyle = colours.dim; c.textAlign = "center";
      c.fillText("no position yet", width / 2, height / 2);
      return;
    }
    let [west, east, south, north] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const [e, n] of here ? [...knots, here] : knots) {
      west = Math.min(west, e); east = Math.max(east, e); south = Math.min(south, n); north = Math.max(north, n);
    }
    const margin = 22;
    const scale = Math.min((width - 2 * margin) / Math.max(east - west, 60), (height - 2 * margin) / Math.max(north - south, 60));
    const x = (e) => width / 2 + (e - (west + east) / 2) * scale;
    const y = (n) => height / 2 - (n - (south + north) / 2) * scale;
    c.font = FONT;
    c.textAlign = "left";
    c.strokeStyle = colours.road;
    c.lineWidth = 3;
    c.lineJoin = "round";
    c.beginPath();
    for (const [e, n] of knots) c.lineTo(x(e), y(n));
    if (here) c.lineTo(x(here[0]), y(here[1]));
    c.stroke();

    const length = knots.length ? knots[knots.length - 1][2] : 0;
    const step = [100, 200, 500, 1000, 2000, 5000, 10000, 20000, 50000].find((m) => length / m <= 6) ?? 100000;
    c.fillStyle = colours.dim;
    let station = 0;
    for (const [e, n, s] of knots) {
      if (s < station) continue;
      c.beginPath(); c.arc(x(e), y(n), 3.5, 0, 7); c.fill();
      c.fillText(step < 1000 ? `${station} m` : `${station / 1000} km`, x(e) + 7, y(n) - 5);
      station += step;
    }
    c.fillStyle = colours.warn;
    for (const { place_m: place } of markers) {
      if (!place) continue;
      const [px, py] = [x(place[0]), y(place[1])];
      c.beginPath(); c.moveTo(px, py); c.lineTo(px - 6, py - 14); c.lineTo(px + 6, py - 14); c.fill();
    }
    if (here) {
      c.save();
      c.translate(x(here[0]), y(here[1]));
      c.rotate((motion.heading_deg * Math.PI) / 180);
      c.fillStyle = colours.accent;
      c.beginPath(); c.moveTo(0, -11); c.lineTo(7, 8); c.lineTo(0, 4); c.lineTo(-7, 8); c.fill();
      c.restore();
    }
  }
}
