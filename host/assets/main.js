// The operator's page: what comes from the server onto the screen, keys and touches to the server.

import { Wire } from "/wire.js";
import { SectionView, ink } from "/section.js";
import { Strip, TrackView } from "/charts.js";
import { Settings } from "/settings.js";
import * as panels from "/panels.js";

const $ = (id) => document.getElementById(id);
const COLOURS = ["ink", "dim", "grid", "road", "adjacent", "opposing", "point", "accent", "warn"];
const MOST_MOMENTS = 1300;

const scene = { section: null, moments: [], stripEpoch: -1, knots: [], trackEpoch: -1, state: null, control: { mine: false, held: false, viewers: 0 }, open: false };
let dirty = { section: true, strips: true, track: true };
let colours = {};
let dragging = false;

const section = new SectionView($("section"));
const numbers = [new panels.Numbers($("numbers-left"), "Left"), new panels.Numbers($("numbers-right"), "Right")];
const strips = [
  [new Strip($("chart-roll"), [[1, "accent"]], { symmetric: true, least: 1 }), $("now-roll"), [1]],
  [new Strip($("chart-left"), [[2, "adjacent"], [3, "opposing"]], { least: 1 }), $("now-left"), [2, 3]],
  [new Strip($("chart-right"), [[4, "adjacent"], [5, "opposing"]], { least: 1 }), $("now-right"), [4, 5]],
];
const track = new TrackView($("track"));

function heard(message) {
  switch (message.kind) {
    case "section":
      scene.section = message;
      scene.sectionAt = performance.now();
      dirty.section = true;
      break;
    case "strips":
      if (message.epoch !== scene.stripEpoch) { scene.moments = []; scene.stripEpoch = message.epoch; }
      scene.moments.push(...message.moments);
      scene.moments.splice(0, Math.max(0, scene.moments.length - MOST_MOMENTS));
      dirty.strips = true;
      break;
    case "track":
      if (message.epoch !== scene.trackEpoch) { scene.knots = []; scene.trackEpoch = message.epoch; }
      scene.knots.push(...message.knots);
      dirty.track = true;
      break;
    case "state":
      scene.state = message;
      dirty.track = true;
      showState();
      break;
    case "control":
      scene.control = message;
      showControl();
      break;
  }
}

const wire = new Wire(heard, (open) => {
  scene.open = open;
  if (open) {
    // The server tells everything again to who comes anew.
    Object.assign(scene, { moments: [], stripEpoch: -1, knots: [], trackEpoch: -1 });
    panels.say("");
  } else {
    panels.say("No connection to the program: is `crossfall serve` running? Trying again. A recording goes on without this page.");
    panels.showLamps(Object.fromEntries(["lidar", "ins", "pulse", "disk", "link"].map((name) => [name, { light: "off", words: "not connected to the program", advice: "" }])));
  }
  showControl();
});

async function ask(request) {
  const answer = await wire.ask(request);
  if (!answer.ok) panels.say(answer.error, "mild");
  return answer;
}

function showState() {
  const { state } = scene;
  const worst = panels.showLamps(state.lamps);
  // A word about what was just asked for has its seconds first.
  if (!panels.saying()) panels.say(worst ? `${worst.words} ${worst.advice}` : "");
  panels.showDrive(state);
  panels.showRecording(state);
  panels.showLosses(state);
  panels.showMarkers(state);
  settings.show(state.rock_test);
  const replay = state.replay;
  $("replay").hidden = !replay;
  if (replay) {
    $("seek").max = replay.length_s;
    if (!dragging) $("seek").value = replay.position_s;
    $("place").textContent = `${panels.clock(replay.position_s)} / ${panels.clock(replay.length_s)}`;
    $("play").textContent = replay.ended ? "Again" : replay.paused ? "Play" : "Pause";
    const times = $("times"), speed = String(replay.speed);
    if (![...times.options].some((option) => option.value === speed)) times.add(new Option(`${speed}×`, speed));
    if (document.activeElement !== times) times.value = speed;
  }
  const still = replay?.ended ? "end of the replay" : replay?.paused ? "replay stands still" : state.lamps.link.light === "bad" ? "no connection to the board" : "";
  $("stale").hidden = !still && !(state.lamps.lidar.light === "bad");
  $("stale").textContent = still || "no scans";
  // What is old must not look like what is now.
  document.querySelector(".road").classList.toggle("old", !$("stale").hidden);
}

function showControl() {
  const { mine, held, viewers } = scene.control;
  const steer = $("steer");
  steer.textContent = mine ? "You steer" : held ? "Take over" : "Take control";
  steer.title = `${viewers} viewer${viewers === 1 ? "" : "s"}`;
  const may = scene.open && (mine || !held);
  for (const id of ["record", "mark", "config-apply", "restart-lidar", "restart-ins", "play", "seek", "times"]) $(id).disabled = !may;
  for (const button of document.querySelectorAll(".mark-kind")) button.disabled = !may;
}

const settings = new Settings(ask);

async function record() {
  if ($("record").disabled) return;
  const on = scene.state?.recording.phase !== "idle";
  const { ok, result } = await ask(on ? { do: "stop" } : { do: "record", name: $("drive").value });
  if (ok && !on) panels.say(`Recording to ${result.file}`, "fine");
}

async function mark(label) {
  if ($("mark").disabled) return;
  const { ok } = await ask({ do: "mark", label });
  if (ok) panels.say(`Marker${label ? `: ${label}` : ""} dropped`, "fine");
}

$("record").onclick = record;
$("mark").onclick = () => mark("");
for (const button of document.querySelectorAll(".mark-kind")) button.onclick = () => mark(button.dataset.label);
$("steer").onclick = () => ask(scene.control.mine ? { do: "release" } : { do: "control", take: true });
$("play").onclick = () => { const { paused, ended } = scene.state.replay; ask({ do: "pause", paused: !(paused || ended) }); };
$("times").onchange = (event) => ask({ do: "speed", times: Number(event.target.value) });
$("seek").oninput = () => { dragging = true; };
$("seek").onchange = async (event) => { await ask({ do: "seek", seconds: Number(event.target.value) }); dragging = false; };

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  if (event.target.closest("input, select, textarea")) { if (event.key === "Escape" && !$("settings").open) event.target.blur(); if (event.key === "Enter" && event.target.closest("#config")) { event.preventDefault(); settings.apply(); } return; }
  if ($("settings").open && event.key.toLowerCase() !== "s") return;
  const kinds = [...document.querySelectorAll(".mark-kind")];
  const keys = { r: record, m: () => mark(""), s: () => settings.open(), t: turn, " ": () => { if (!$("replay").hidden && event.target === document.body) $("play").click(); } };
  const chosen = keys[event.key.toLowerCase()] ?? (kinds[Number(event.key) - 1] && (() => mark(kinds[Number(event.key) - 1].dataset.label)));
  if (chosen && !(event.key === " " && event.target !== document.body)) { event.preventDefault(); chosen(); }
});

// Day and night: as the system says, until it is chosen here.
const system = matchMedia("(prefers-color-scheme: dark)");
function paint() {
  const chosen = sessionStorage.getItem("theme");
  document.documentElement.dataset.theme = chosen ?? (system.matches ? "dark" : "light");
  colours = Object.fromEntries(COLOURS.map((name) => [name, ink(name)]));
  dirty = { section: true, strips: true, track: true };
}
function turn() {
  sessionStorage.setItem("theme", document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  paint();
}
$("theme").onclick = turn;
system.onchange = paint;
new ResizeObserver(() => { dirty = { section: true, strips: true, track: true }; }).observe(document.querySelector("main"));

// Draws what has changed, once a frame of the screen; counts the frames.
let frames = 0, since = performance.now(), sections = 0;
function frame(now) {
  frames++;
  if (dirty.section && scene.section) {
    dirty.section = false;
    sections++;
    section.draw(scene.section, colours);
    scene.section.sides.forEach((side, i) => numbers[i].show(side));
  }
  if (dirty.strips) {
    dirty.strips = false;
    const last = scene.moments.at(-1);
    for (const [chart, now, columns] of strips) {
      chart.draw(scene.moments, colours);
      if (last) now.textContent = columns.map((column) => `${panels.signed(last[column], 1)}°`).join("  ");
    }
    settings.draw(scene.moments, colours);
  }
  if (dirty.track) {
    dirty.track = false;
    track.draw(scene.knots, scene.state?.motion, scene.state?.markers ?? [], colours);
  }
  if (now - since >= 1000) {
    const seconds = (now - since) / 1000;
    window.crossfall = { fps: frames / seconds, sections: sections / seconds };
    $("rate").textContent = `${Math.round(frames / seconds)} fps`;
    [frames, sections, since] = [0, 0, now];
  }
  requestAnimationFrame(frame);
}
paint();
showControl();
requestAnimationFrame(frame);
