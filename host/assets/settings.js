// Setup: sensors, rock test, configuration.

import { Strip } from "/charts.js";
import { signed } from "/panels.js";

const $ = (id) => document.getElementById(id);

/** A line of the configuration's TOML: key, value, what it is. */
const LINE = /^([a-z_0-9]+) = (\[[^\]]*\]|"[^"]*"|[^#]*?)\s*(?:# (.*))?$/;
const CHOICES = { method: ['"measuring"', '"seed"'], mirrored: ["false", "true"] };

/** What of an estimate can be put in force, in words; nothing when it tells neither. */
const known = (estimate) => [estimate?.offset_determined && "offset", estimate?.delay_determined && "delay"].filter(Boolean).join(" and ");

export class Settings {
  constructor(ask) {
    this.ask = ask;
    this.chart = new Strip($("chart-rock"), [[6, "accent"]], { symmetric: true, least: 0.1, seconds: 30 });
    $("open-settings").onclick = () => this.open();
    $("restart-lidar").onclick = () => this.restart("lidar");
    $("restart-ins").onclick = () => this.restart("ins");
    for (const [id, request] of [
      ["rock-begin", { do: "rock_test", action: "begin" }],
      ["rock-end", { do: "rock_test", action: "end" }],
      ["rock-cancel", { do: "rock_test", action: "cancel" }],
    ]) $(id).onclick = async () => { const { ok, error } = await ask(request); if (!ok) this.rockSays(error, "wrong"); };
    $("rock-apply").onclick = async () => {
      const { found } = this;
      const { ok, error } = await ask({ do: "apply_rock_test" });
      this.rockSays(ok ? `In force: the board has echoed the new ${found}.` : error, ok ? "right" : "wrong");
      if (ok) { this.held = true; this.load(); }
    };
    $("config-apply").onclick = () => this.apply();
    $("config-reload").onclick = () => this.load();
    $("config").onsubmit = (event) => event.preventDefault();
  }

  open() {
    if ($("settings").open) return $("settings").close();
    $("settings").showModal();
    this.load();
  }

  async restart(sensor) {
    const { ok, error } = await this.ask({ do: "restart", sensor });
    this.configSays(ok ? "" : error, "wrong");
    const button = $(`restart-${sensor}`);
    const name = button.textContent;
    button.textContent = ok ? "Restarting" : error;
    setTimeout(() => { button.textContent = name; }, 3000);
  }

  rockSays(words, kind = "") { $("rock-words").textContent = words; $("rock-words").className = kind; }
  configSays(words, kind = "") { $("config-words").textContent = words; $("config-words").className = kind; }

  /** The configuration in force as a form. */
  async load() {
    const response = await fetch("/api/config");
    const { toml, error } = await response.json();
    if (!response.ok) return this.configSays(error, "wrong");
    this.configSays("");
    this.fields = [];
    const rows = [];
    let table = "", above = "";
    for (const line of toml.split("\n")) {
      const head = line.match(/^\[(.+)\]$/), pair = line.match(LINE);
      if (line.startsWith("# ")) above = line.slice(2);
      else if (head) {
        table = head[1];
        const title = document.createElement("h3");
        title.textContent = above || table;
        rows.push(title);
        above = "";
      } else if (pair) {
        const [, key, value, about = ""] = pair;
        const label = document.createElement("label"), words = document.createElement("span");
        const choices = CHOICES[key];
        const input = document.createElement(choices ? "select" : "input");
        for (const choice of choices ?? []) input.add(new Option(choice.replaceAll('"', ""), choice));
        input.id = `config-${table}-${key}`.replaceAll(".", "-");
        label.htmlFor = input.id;
        label.textContent = key.replace(/_([a-z]+)$/, (whole, unit) => ({ deg: " (°)", ms: " (ms)", mm: " (mm)", m: " (m)" })[unit] ?? whole).replaceAll("_", " ");
        input.value = value;
        input.autocomplete = "off";
        input.oninput = () => input.classList.toggle("changed", input.value !== value);
        words.textContent = about;
        this.fields.push({ table, key, input });
        rows.push(label, input, words);
      }
    }
    $("config").replaceChildren(...rows);
  }

  async apply() {
    if (!this.fields) return;
    let toml = "", table = "";
    for (const field of this.fields) {
      if (field.table !== table) toml += `[${(table = field.table)}]\n`;
      toml += `${field.key} = ${field.input.value.trim()}\n`;
    }
    this.configSays("asking the board");
    const { ok, error } = await this.ask({ do: "configure", toml });
    if (ok) await this.load();
    this.configSays(ok ? "In force: the board has echoed it." : error, ok ? "right" : "wrong");
  }

  /** The state of the rock test. */
  show(test) {
    $("rock-begin").disabled = Boolean(test?.running || test?.estimating);
    $("rock-end").disabled = !(test?.running && test.scans >= test.enough);
    $("rock-cancel").disabled = !test;
    this.found = known(test?.estimate);
    $("rock-apply").disabled = !this.found;
    $("rock-apply").textContent = this.found && this.found !== "offset and delay" ? `Put ${this.found} in force` : "Put in force";
    if (!test) { if (!this.held) this.rockSays(""); this.told = null; return; }
    this.held = false;
    if (test.running) {
      const [mean, spread] = test.residual_deg ?? [NaN, NaN];
      const enough = test.scans >= test.enough ? "enough for an answer; longer is better" : `${Math.ceil((test.enough - test.scans) / 37.5)} s to go at least`;
      const rocking = test.roll_rate_deg_s < 1 ? "rock harder" : "rocking well";
      this.rockSays(`${test.scans} scans, ${enough}. Roll rate ${test.roll_rate_deg_s.toFixed(1)}°/s: ${rocking}. Ground seems tilted ${signed(mean, 3)}° ± ${spread.toFixed(3)}°.`);
    } else if (test.estimating) this.rockSays("working on it");
    else if (test.refusal) this.rockSays(test.refusal, "wrong");
    else if (this.told !== test.estimate?.roll_offset_deg) {
      this.told = test.estimate.roll_offset_deg;
      const e = test.estimate;
      const delay = e.delay_determined ? `delay ${(e.lidar_delay_us / 1000).toFixed(2)} ± ${(e.lidar_delay_se_us / 1000).toFixed(2)} ms` : "delay not determined";
      this.rockSays(`Offset ${signed(e.roll_offset_deg, 3)}° ± ${e.roll_offset_se_deg.toFixed(3)}°, ${delay}; ground steadier: ${e.residual_before_deg.toFixed(3)}° before, ${e.residual_after_deg.toFixed(3)}° after. ${e.remarks.join(". ")}.`);
    }
  }

  draw(moments, colours) { if ($("settings").open) this.chart.draw(moments, colours); }
}
