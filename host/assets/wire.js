// The bytes and texts of the server (docs/live.md): decoding, asking, reconnecting.

const SECTION = 1, STRIPS = 2, TRACK = 3, VERSION = 1;
const UNIT_M = 0.004;

/** A binary message as an object with a `kind`; null when it is of a version that this page does not know. */
export function decode(buffer) {
  const view = new DataView(buffer);
  if (view.byteLength < 8 || view.getUint8(1) !== VERSION) return null;
  const count = view.getUint16(2, true);
  let at = 4;
  const u32 = () => { at += 4; return view.getUint32(at - 4, true); };
  const f32 = () => { at += 4; return view.getFloat32(at - 4, true); };
  const f64 = () => { at += 8; return view.getFloat64(at - 8, true); };
  switch (view.getUint8(0)) {
    case SECTION: {
      const section = { kind: "section", scan: u32(), time: f64(), roll: f32(), sides: [] };
      for (let side = 0; side < 2; side++) {
        const found = { flags: u32(), edge: f32(), edgeCi: f32() };
        for (const name of ["road", "adjacent", "opposing"]) {
          const piece = { slope: f32(), ci: f32(), points: f32(), y0: f32(), z0: f32(), y1: f32(), z1: f32() };
          found[name] = Number.isNaN(piece.slope) ? null : piece;
        }
        section.sides.push(found);
      }
      section.points = new Float32Array(2 * count);
      for (let i = 0; i < 2 * count; i++) section.points[i] = view.getInt16(at + 2 * i, true) * UNIT_M;
      return section;
    }
    case STRIPS: {
      const strips = { kind: "strips", epoch: u32(), moments: [] };
      for (let i = 0; i < count; i++) {
        const time = f64();
        strips.moments.push([time, f32(), f32(), f32(), f32(), f32(), f32(), f32()]);
      }
      return strips;
    }
    case TRACK: {
      const track = { kind: "track", epoch: u32(), knots: [] };
      for (let i = 0; i < count; i++) track.knots.push([f32(), f32(), f32()]);
      return track;
    }
    default: return null;
  }
}

/** The connection: `heard` gets everything, `changed` whether it is open. It is tried again for ever. */
export class Wire {
  constructor(heard, changed) {
    this.heard = heard;
    this.changed = changed;
    this.asked = new Map();
    this.next = 1;
    this.pause = 250;
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(`${scheme}//${location.host}/api/live`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => { this.pause = 250; this.changed(true); };
    this.socket.onmessage = ({ data }) => {
      const message = typeof data === "string" ? JSON.parse(data) : decode(data);
      if (message?.kind === "reply") {
        this.asked.get(message.id)?.(message);
        this.asked.delete(message.id);
      } else if (message) this.heard(message);
    };
    this.socket.onclose = () => {
      this.changed(false);
      for (const answer of this.asked.values()) answer({ ok: false, error: "the connection to the program is lost" });
      this.asked.clear();
      setTimeout(() => this.connect(), this.pause);
      this.pause = Math.min(2 * this.pause, 3000);
    };
  }

  /** Asks for something; the answer has `ok`, and `error` in words or `result`. */
  ask(request) {
    if (this.socket.readyState !== WebSocket.OPEN) return Promise.resolve({ ok: false, error: "not connected to the program" });
    const id = this.next++;
    this.socket.send(JSON.stringify({ id, ...request }));
    return new Promise((answer) => this.asked.set(id, answer));
  }
}
