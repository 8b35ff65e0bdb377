"use strict";
// Follows the pointer along the road: a line through the strips, a dot on the map, the values, and the nearest section.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const strips = document.getElementById("strips");
  const { left, right, from, to } = data.chart;
  const names = ["left adjacent", "left opposing", "right adjacent", "right opposing"];
  const sign = (value, digits) => (value < 0 ? "\u2212" : "+") + Math.abs(value).toFixed(digits);
  const ratio = (degrees) => {
    const rise = Math.tan(Math.abs(degrees) * Math.PI / 180);
    return rise > 0.005 ? ` (1:${(1 / rise).toFixed(1)})` : "";
  };
  // Index of the value nearest to x in a rising list.
  const nearest = (list, x, of = (one) => one) => {
    let low = 0, high = list.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (of(list[middle]) > x) high = middle; else low = middle;
    }
    return list.length && Math.abs(of(list[high]) - x) < Math.abs(of(list[low]) - x) ? high : low;
  };
  let held = false, current = 0;

  function go(index) {
    if (!data.x.length) return;
    current = Math.max(0, Math.min(data.x.length - 1, index));
    const at = data.x[current];
    const x = left + (at - from) / (to - from) * (right - left);
    const cursor = document.getElementById("cursor");
    cursor.setAttribute("d", cursor.getAttribute("d").replace(/^M[-\d.]+/, `M${x.toFixed(1)}`));
    const here = document.getElementById("here"), place = data.map[current];
    if (here && place) { here.setAttribute("cx", place[0]); here.setAttribute("cy", place[1]); }
    const parts = names.flatMap((name, i) => {
      const slope = data.slopes[i][current];
      if (slope === null) return [];
      return [`${name} <b>${sign(slope, 2)}\u00b0</b> \u00b1${data.ci[i][current].toFixed(2)}\u00b0${ratio(slope)}`];
    });
    const where = data.unit === "m" ? `${at.toFixed(data.width < 1 ? 1 : 0)} m` : `scan ${at.toFixed(0)}`;
    document.getElementById("values").innerHTML = `<b>${where}</b> \u00b7 ${parts.join(" \u00b7 ") || "no slope found"}`;
    if (data.sections.length) section(data.sections[nearest(data.sections, at, (one) => one.at)]);
  }

  const make = (name, attributes, text) => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const key in attributes) node.setAttribute(key, attributes[key]);
    if (text !== undefined) node.textContent = text;
    return node;
  };
  const step = (span, about) => {
    const decade = 10 ** Math.floor(Math.log10(span / about));
    return [1, 2, 5, 10].map((one) => one * decade).find((one) => one >= span / about);
  };

  let shown = null;
  function section(one) {
    if (shown === one) return;
    shown = one;
    const svg = document.getElementById("section");
    svg.replaceChildren();
    const y = one.y.map((mm) => mm / 1000), z = one.z.map((mm) => mm / 1000);
    const outer = one.lines.map(([, ends]) => Math.max(Math.abs(ends[0]), Math.abs(ends[2])) / 1000);
    const reach = Math.min(30, Math.max(8, ...outer) * 1.12);
    const seen = z.filter((_, i) => Math.abs(y[i]) <= reach);
    let low = Math.min(...seen), high = Math.max(...seen);
    if (!seen.length) { low = -5; high = 0; }
    const room = Math.max(1, high - low);
    low -= 0.12 * room; high += 0.32 * room;
    const px = (lateral) => 46 + (reach - lateral) / (2 * reach) * 584;
    const py = (height) => 326 - (height - low) / (high - low) * 316;
    for (let tick = Math.ceil(-reach / 5) * 5; tick <= reach; tick += 5) {
      svg.append(make("path", { class: "grid", d: `M${px(tick)} 10V326` }));
      svg.append(make("text", { class: "tick", x: px(tick), y: 343, "text-anchor": "middle" }, tick ? sign(tick, 0) : "0"));
    }
    const gap = step(high - low, 6);
    for (let i = Math.ceil(low / gap); i * gap <= high; i++) {
      svg.append(make("path", { class: "grid", d: `M46 ${py(i * gap)}H630` }));
      svg.append(make("text", { class: "tick", x: 40, y: py(i * gap) + 4, "text-anchor": "end" },
        i ? sign(i * gap, gap < 1 ? 1 : 0) : "0"));
    }
    for (let i = 0; i < y.length; i++) {
      if (Math.abs(y[i]) <= reach && z[i] >= low && z[i] <= high) {
        svg.append(make("circle", { class: "point", cx: px(y[i]).toFixed(1), cy: py(z[i]).toFixed(1), r: 1.7 }));
      }
    }
    const kinds = ["road", "adjacent", "opposing"];
    // Labels of one side would run into each other where their slopes are short: each stands higher than the last.
    for (const [part, ends, slope, ci] of one.lines) {
      const [y0, z0, y1, z1] = ends.map((mm) => mm / 1000);
      svg.append(make("path", { class: `fit ${kinds[part]}`, d: `M${px(y0)} ${py(z0)}L${px(y1)} ${py(z1)}` }));
      const onLeft = (y0 + y1) / 2 > 0;
      const text = sign(slope, 2) + "\u00b0" + (ci === null ? "" : ` \u00b1${ci.toFixed(2)}\u00b0`);
      if (part > 0) {
        const row = 24 + (2 - part) * 18;
        const x = px((y0 + y1) / 2);
        svg.append(make("path", { class: "grid", d: `M${x} ${row + 4}V${py((z0 + z1) / 2)}` }));
        const anchor = part === 2 ? (onLeft ? "start" : "end") : "middle";
        const place = anchor === "middle" ? x : anchor === "start" ? Math.max(50, x - 60) : Math.min(626, x + 60);
        svg.append(make("text", { class: kinds[part], x: place, y: row, "text-anchor": anchor, "font-weight": 600 }, text));
      }
    }
    const where = data.unit === "m" ? `at ${one.at.toFixed(1)} m, ` : "";
    document.getElementById("which").textContent = `${where}scan ${one.scan}, roll ${sign(one.roll, 2)}\u00b0`;
  }

  const pointed = (event) => {
    const box = strips.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width * 1000;
    return nearest(data.x, from + (x - left) / (right - left) * (to - from));
  };
  strips.addEventListener("pointermove", (event) => { if (!held) go(pointed(event)); });
  strips.addEventListener("click", (event) => { held = !held || pointed(event) !== current; go(pointed(event)); });
  strips.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: -1, ArrowRight: 1, PageUp: -20, PageDown: 20 }[event.key];
    if (by) { event.preventDefault(); held = true; go(current + by); }
  });
  const map = document.getElementById("map");
  map.addEventListener("click", (event) => {
    const box = map.getBoundingClientRect();
    const [x, y] = [(event.clientX - box.left) / box.width * 480, (event.clientY - box.top) / box.height * 360];
    let best = -1, least = Infinity;
    data.map.forEach((place, i) => {
      const distance = place ? (place[0] - x) ** 2 + (place[1] - y) ** 2 : Infinity;
      if (distance < least) [best, least] = [i, distance];
    });
    if (best >= 0) { held = true; go(best); }
  });
  go(data.x.length >> 1);
})();
