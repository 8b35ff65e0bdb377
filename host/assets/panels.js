// Everything on the page that is text: lamps, figures, losses, markers.

const $ = (id) => document.getElementById(id);
const set = (node, text) => { if (node.textContent !== text) node.textContent = text; };

const FLAGS = ["no attitude", "attitude held", "attitude degraded", "timed by arrival", "scanner status", "no road", "rounded edge", "vegetation", "obstructed", "end unseen", "doubtful", "partial scan"];

export function signed(value, digits) {
  return Number.isNaN(value) || value === undefined ? "–" : (value < 0 ? "−" : "+") + Math.abs(value).toFixed(digits);
}

export function clock(seconds) {
  const whole = Math.floor(seconds), two = (n) => String(n).padStart(2, "0");
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  return h ? `${h}:${two(m)}:${two(s)}` : `${m}:${two(s)}`;
}

export function size(bytes) {
  return bytes < 1e6 ? `${Math.round(bytes / 1e3)} kB` : bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(2)} GB`;
}

/** The slopes beside the section. */
export class Numbers {
  constructor(root, name) {
    root.innerHTML = `<div class="side">${name}</div>` +
      ["adjacent", "opposing"].map((kind) => `<div class="row ${kind}"><span class="name">${kind}</span><span class="figure"></span><span class="ci"></span></div>`).join("") +
      '<div class="flags"></div>';
    this.figures = [...root.querySelectorAll(".figure")];
    this.intervals = [...root.querySelectorAll(".ci")];
    this.flags = root.querySelector(".flags");
  }

  show(side) {
    [side.adjacent, side.opposing].forEach((piece, i) => {
      set(this.figures[i], piece ? `${signed(piece.slope, 2)}°` : "–");
      set(this.intervals[i], piece && !Number.isNaN(piece.ci) ? `±${piece.ci.toFixed(2)}°` : "");
    });
    set(this.flags, FLAGS.filter((_, bit) => side.flags & (1 << bit)).join(", "));
  }
}

const LAMPS = ["lidar", "ins", "pulse", "disk", "link"];
const COLOURS = { good: "green", warn: "amber", bad: "red", off: "off" };
const PARTS = { lidar: "LiDAR", ins: "INS", pulse: "Pulse", disk: "Disk", link: "Link" };

/** Lamps, and what to do about the worst of them. A lamp that changes is told to screen readers. */
export function showLamps(lamps) {
  let worst = null;
  const changed = [];
  for (const name of LAMPS) {
    const { light, words, advice } = lamps[name];
    const node = $(`lamp-${name}`);
    if (node.className !== light) {
      node.className = light;
      changed.push(`${PARTS[name]}: ${COLOURS[light]}, ${words}.`);
    }
    set(node.querySelector("span"), words);
    node.title = advice;
    if (light === "bad" && (!worst || name === "link")) worst = { words: `${PARTS[name]}: ${words}.`, advice };
  }
  if (changed.length) $("lamps-told").textContent = changed.join(" ");
  return worst;
}

export function showDrive(state) {
  const { speed_m_s: speed, station_m: station, points_per_mile: density } = state.motion;
  set($("speed"), speed == null ? "–" : (speed * 3.6).toFixed(speed * 3.6 < 10 ? 1 : 0));
  set($("station"), station == null ? "–" : (station / 1000).toFixed(2));
  set($("density"), density == null ? "–" : Math.round(density).toLocaleString("en"));
  const board = state.board ? `${state.board.firmware}, ${state.board.board}` : "no board heard yet";
  const name = state.source.kind === "device" ? state.source.name : state.source.name.split(/[\\/]/).at(-1);
  set($("source"), `${name} · ${board}`);
  $("source").title = state.source.name;
}

/** What is on the tape, or has become of the last one: the server has the words. */
function taped(state, recording) {
  const amiss = state.recording_amiss;
  return [recording === state.recording || amiss.length ? "" : "saved", size(recording.bytes), ...amiss].filter(Boolean).join(", ");
}

export function showRecording(state) {
  const { recording: now, last_recording: last } = state;
  const on = now.phase !== "idle";
  const button = $("record");
  button.classList.toggle("on", on);
  button.classList.toggle("busy", now.phase === "starting" || now.phase === "ending");
  set($("record-label"), { idle: "Record", starting: "Starting", recording: "Stop", ending: "Ending" }[now.phase]);
  button.setAttribute("aria-pressed", String(on));
  const shown = on ? now : last;
  set($("record-time"), clock(shown?.seconds ?? 0));
  set($("record-size"), shown ? taped(state, shown) : "not recording");
  $("record-size").title = $("record-size").textContent;
  $("drive").disabled = on;
  $("drive").placeholder = on ? now.name : "date and time";
}

export function showLosses(state) {
  const [latest] = state.faults;
  $("fault").className = latest && latest.seconds_ago < 60 ? "bad" : "";
  const ago = latest && (latest.seconds_ago < 60 ? `${latest.seconds_ago} s ago` : `${Math.floor(latest.seconds_ago / 60)} min ago`);
  set($("fault-words"), latest ? `${latest.words} (${ago})` : "No fault so far.");
  set($("fault-advice"), latest?.advice ?? "");
  const names = Object.entries(state.losses);
  const lost = names.filter(([, count]) => count > 0);
  const shown = lost.length ? lost.map(([name, count]) => `<li class="some">${name.replace(/[._]/g, " ")} ${count}</li>`).join("")
    : names.length ? `<li>all ${names.length} loss counters are 0</li>` : "";
  if ($("counters").innerHTML !== shown) $("counters").innerHTML = shown;
}

export function showMarkers(state) {
  const list = $("markers");
  const shown = state.markers.slice(-8).reverse();
  const key = `${state.marker_count}`;
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(...shown.map((marker) => {
    const item = document.createElement("li");
    const name = document.createElement("b");
    name.textContent = marker.label || `mark ${marker.number + 1}`;
    item.append(name, marker.station_m == null ? "" : ` ${(marker.station_m / 1000).toFixed(3)} km`);
    return item;
  }));
}

let fading = 0;
/** A message across the page. Faults stay until they are over; `mild` and `fine` ones go after a few seconds. */
export function say(words, kind = "") {
  const node = $("notice");
  clearTimeout(fading);
  node.className = kind;
  set(node, words);
  if (words && kind) fading = setTimeout(() => { node.textContent = ""; node.className = ""; }, 6000);
}
export const saying = () => $("notice").className !== "" && $("notice").textContent !== "";
