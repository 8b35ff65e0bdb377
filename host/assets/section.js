// The live section: levelled points, road, edges and slopes, drawn to one scale in both directions (stretched up to 2.5 times in height where there is room).

/** Colours of the theme, by their names in live.css. */
export function ink(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** The context of a canvas whose pixels are the screen's; its size in CSS pixels. */
export function prepare(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

const FONT = '600 13px system-ui, "DejaVu Sans", sans-serif';

export class SectionView {
  constructor(canvas) {
    this.canvas = canvas;
    // Metres that fill the screen; they follow the data slowly, so that the picture does not jump.
    this.reach = 14;
    this.low = -5;
    this.high = -1;
  }

  draw(section, colours) {
    const { context: c, width, height } = prepare(this.canvas);
    if (!section || width < 50) return;
    this.follow(section);
    const top = Math.min(138, 0.42 * height), bottom = 30;
    const across = width / (2 * this.reach);
    const up = Math.min(2.5 * across, (height - top - bottom) / (this.high - this.low));
    // Left of the vehicle is left on the screen.
    const x = (y) => width / 2 - y * across;
    const free = height - top - bottom - up * (this.high - this.low);
    const z = (h) => top + free / 2 + (this.high - h) * up;

    c.font = FONT;
    c.lineWidth = 1;
    c.strokeStyle = colours.grid;
    c.fillStyle = colours.dim;
    c.textAlign = "center";
    const step = this.reach > 20 ? 10 : this.reach > 8 ? 5 : 2;
    for (let y = -Math.floor(this.reach / step) * step; y <= this.reach; y += step) {
      c.beginPath(); c.moveTo(x(y), top - 10); c.lineTo(x(y), height - bottom + 4); c.stroke();
      const name = `${Math.abs(y)} m`, room = c.measureText(name).width / 2;
      if (x(y) > room && x(y) < width - room) c.fillText(name, x(y), height - 10);
    }

    for (const side of section.sides) {
      this.piece(c, side.road, x, z, colours.road, 4);
      this.piece(c, side.adjacent, x, z, colours.adjacent, 6);
      this.piece(c, side.opposing, x, z, colours.opposing, 6);
    }
    c.fillStyle = colours.point;
    const { points } = section;
    for (let i = 0; i < points.length; i += 2) {
      const px = x(points[i]), pz = z(points[i + 1]);
      if (px > -4 && px < width + 4 && pz > top - 30) c.fillRect(px - 1.5, pz - 1.5, 3, 3);
    }
    for (const side of section.sides) {
      if (Number.isNaN(side.edge)) continue;
      const foot = side.road ? side.road.z1 : side.adjacent ? side.adjacent.z0 : 0;
      const px = x(side.edge), pz = z(foot);
      c.strokeStyle = colours.ink;
      c.lineWidth = 2;
      c.beginPath(); c.moveTo(px, pz - 26); c.lineTo(px, pz + 10); c.stroke();
      c.fillStyle = colours.ink;
      // Outward from the edge: those of a narrow road would lie on each other.
      const name = `edge ${Math.abs(side.edge).toFixed(2)} m`, room = c.measureText(name).width + 4;
      c.textAlign = side.edge > 0 ? "right" : "left";
      c.fillText(name, side.edge > 0 ? Math.max(px, room) : Math.min(px, width - room), pz - 32);
    }
    c.textAlign = "center";
    // The sensor.
    c.fillStyle = colours.ink;
    const lens = Math.max(z(0), top - 14);
    c.beginPath(); c.arc(x(0), lens, 5, 0, 7); c.fill();
    c.fillStyle = colours.dim;
    c.fillText("scanner", x(0), lens - 11);
  }

  piece(c, piece, x, z, colour, width) {
    if (!piece) return;
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.lineCap = "round";
    c.beginPath(); c.moveTo(x(piece.y0), z(piece.z0)); c.lineTo(x(piece.y1), z(piece.z1)); c.stroke();
  }

  /** The extent of what was measured and most of what was seen. */
  follow(section) {
    const ys = [], zs = [];
    for (let i = 0; i < section.points.length; i += 2) {
      if (Math.abs(section.points[i]) < 40) { ys.push(Math.abs(section.points[i])); zs.push(section.points[i + 1]); }
    }
    if (ys.length < 20) return;
    ys.sort((a, b) => a - b);
    zs.sort((a, b) => a - b);
    let reach = ys[Math.floor(ys.length * 0.97)] + 1;
    for (const side of section.sides) {
      for (const piece of [side.adjacent, side.opposing]) if (piece) reach = Math.max(reach, Math.abs(piece.y1) + 1);
    }
    const slow = (now, then) => now + 0.03 * (then - now);
    this.reach = slow(this.reach, Math.min(40, Math.max(6, reach)));
    this.low = slow(this.low, zs[Math.floor(zs.length * 0.01)] - 0.4);
    this.high = slow(this.high, zs[Math.floor(zs.length * 0.99)] + 0.5);
  }
}
