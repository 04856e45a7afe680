"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const make = (name, about = {}, ...inside) => {
  const node = name === "svg" || about.ns ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
  for (const [key, value] of Object.entries(about)) if (key !== "ns") node.setAttribute(key, value);
  node.append(...inside);
  return node;
};
const draw = (name, about = {}, ...inside) => make(name, { ...about, ns: 1 }, ...inside);
const colourOf = title => data.colours[title] || "#000000";
const line = (points, about) => draw("polyline", { points: points.map(p => p.map(v => v.toFixed(1)).join(",")).join(" "), fill: "none", ...about });
const ends = values => [Math.min(...values), Math.max(...values)];

function ticks(low, high, count = 4) {
  const rough = (high - low) / count || 1, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(n => n * power).find(s => s >= rough), found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + step / 1e6; at += step) found.push(+at.toPrecision(6));
  return found;
}

function pathChart(path, title) {
  const all = path.truth_m.concat(path.estimate_m);
  const spans = [0, 1, 2].map(k => { const [a, b] = ends(all.map(p => p[k])); return b - a; });
  const [i, j] = [0, 1, 2].sort((a, b) => spans[b] - spans[a]).slice(0, 2).sort();
  const [x0, x1] = ends(all.map(p => p[i])), [y0, y1] = ends(all.map(p => p[j]));
  const scale = Math.min(330 / (x1 - x0 || 1), 230 / (y1 - y0 || 1));
  const place = p => [50 + (p[i] - x0) * scale, 10 + (y1 - p[j]) * scale], height = 10 + (y1 - y0) * scale, width = 50 + (x1 - x0) * scale;
  const svg = make("svg", { viewBox: `0 0 400 ${Math.max(height + 34, 80)}`, role: "img", "aria-label": `Trajectory of ${title} and the ground truth` });
  for (const t of ticks(x0, x1)) svg.append(draw("text", { x: 50 + (t - x0) * scale, y: height + 14, "text-anchor": "middle" }, `${t}`));
  for (const t of ticks(y0, y1)) svg.append(draw("text", { x: 44, y: 14 + (y1 - t) * scale, "text-anchor": "end" }, `${t}`));
  svg.append(draw("path", { d: `M50 8V${height}H${width + 4}`, class: "axis" }), draw("text", { x: 50 + (x1 - x0) * scale / 2, y: height + 29, "text-anchor": "middle" }, `horizontal: ${"xyz"[i]} in m, vertical: ${"xyz"[j]} in m`));
  svg.append(line(path.truth_m.map(place), { stroke: "var(--grey)", "stroke-width": 4, opacity: .6 }), line(path.estimate_m.map(place), { stroke: colourOf(title), "stroke-width": 1.6 }));
  return svg;
}

function errorChart(path, title) {
  const time = path.stamps_s.map(s => s - path.stamps_s[0]), error = path.error_m.map(e => 1e3 * e), [, last] = ends(time), top = Math.max(...error) || 1;
  const svg = make("svg", { viewBox: "0 0 400 200", role: "img", "aria-label": `Error of ${title} over time` });
  const x = t => 50 + 340 * t / (last || 1), y = e => 165 - 150 * e / top;
  for (const t of ticks(0, last, 6)) svg.append(draw("text", { x: x(t), y: 180, "text-anchor": "middle" }, `${t}`));
  for (const e of ticks(0, top)) svg.append(draw("path", { d: `M50 ${y(e)}H392`, class: "axis", opacity: .5 }), draw("text", { x: 44, y: y(e) + 4, "text-anchor": "end" }, `${e}`));
  svg.append(draw("path", { d: "M50 10V165H392", class: "axis" }), line(time.map((t, k) => [x(t), y(error[k])]), { stroke: colourOf(title), "stroke-width": 1.4 }), draw("text", { x: 220, y: 196, "text-anchor": "middle" }, "time in s; error in mm"));
  return svg;
}

function scatter() {
  const cells = data.cells.filter(c => c.ate > 0 && c.surface > 0), chart = document.getElementById("chart");
  if (cells.length < 2) { chart.textContent = "Fewer than two cells have a surface."; return; }
  const power = key => { const [a, b] = ends(cells.map(c => Math.log10(c[key]))); return [Math.floor(a), Math.max(Math.ceil(b), Math.floor(a) + 1)]; };
  const [x0, x1] = power("ate"), [y0, y1] = power("surface"), width = 560, height = 340;
  const x = v => 60 + (width - 80) * (Math.log10(v) - x0) / (x1 - x0), y = v => height - 45 - (height - 60) * (Math.log10(v) - y0) / (y1 - y0);
  const svg = make("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "ATE against mean surface error of all cells" });
  for (let p = x0; p <= x1; p++) svg.append(draw("path", { d: `M${x(10 ** p)} 15V${height - 45}`, class: "axis" }), draw("text", { x: x(10 ** p), y: height - 29, "text-anchor": "middle" }, `${+(10 ** p).toPrecision(2)}`));
  for (let p = y0; p <= y1; p++) svg.append(draw("path", { d: `M60 ${y(10 ** p)}H${width - 20}`, class: "axis" }), draw("text", { x: 53, y: y(10 ** p) + 4, "text-anchor": "end" }, `${+(10 ** p).toPrecision(2)}`));
  for (const c of cells) svg.append(draw(c.room === "office" ? "rect" : "circle", { ...(c.room === "office" ? { x: x(c.ate) - 4, y: y(c.surface) - 4, width: 8, height: 8 } : { cx: x(c.ate), cy: y(c.surface), r: 4.5 }), fill: c.noise === "noisy" ? colourOf(c.odometer) : "none", stroke: colourOf(c.odometer), "stroke-width": 1.6 }, draw("title", {}, `${c.name}: ATE ${c.ate.toFixed(2)} mm, surface ${c.surface.toFixed(2)} mm`)));
  svg.append(draw("text", { x: width / 2, y: height - 8, "text-anchor": "middle" }, "ATE in mm"), draw("text", { x: 14, y: height / 2 - 20, transform: `rotate(-90 14 ${height / 2 - 20})`, "text-anchor": "middle" }, "mean surface error in mm"));
  chart.append(svg);
  const keys = document.getElementById("keys");
  for (const title of [...new Set(cells.map(c => c.odometer))]) keys.append(make("span", { class: "key", style: `background:${colourOf(title)}` }), `${title} \u2003`);
  keys.append("round: living room, square: office; hollow: clean, filled: noisy");
}

const columns = data.columns, filters = { room: "", trajectory: "", noise: "", odometer: "", preset: "", reference: "" };
let sorted = null, up = true;
const head = document.querySelector("#all thead"), body = document.querySelector("#all tbody"), search = document.getElementById("search");
const listed = ["odometer", "preset", "reference", "ATE mm", "RPE mm/s", "surface mm", "accuracy mm", "completion mm", "Depth L1 mm", "F 1 cm %"], main = ["odometer", "ATE mm", "surface mm"];
const shown = columns.map((name, k) => ({ name, k })).filter(c => listed.includes(c.name) && (c.name !== "preset" || data.several.includes("preset")));
const value = (cell, k) => { const text = cell.row[k], number = parseFloat(text); return data.numeric[k] ? (Number.isNaN(number) ? Infinity : number) : text; };

function header() {
  const row = make("tr");
  for (const { name, k } of [{ name: "sequence", k: -1 }, ...shown]) {
    const button = make("button", { type: "button" }, name), th = make("th", { scope: "col", "aria-sort": sorted === k ? (up ? "ascending" : "descending") : "none", class: (data.numeric[k] ? "n" : "") + (k >= 0 && !main.includes(name) ? " wide" : "") }, button);
    button.addEventListener("click", () => { up = sorted === k ? !up : true; sorted = k; header(); rows(); head.querySelectorAll("button")[[-1, ...shown.map(c => c.k)].indexOf(k)].focus(); });
    row.append(th);
  }
  head.replaceChildren(row);
}

function rows() {
  const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  let cells = data.cells.filter(c => words.every(w => c.search.includes(w)) && Object.entries(filters).every(([key, chosen]) => !chosen || c.row[columns.indexOf(key)] === chosen));
  if (sorted !== null) {
    const of = sorted < 0 ? c => c.sequence : c => value(c, sorted);
    cells = [...cells].sort((a, b) => { const [x, y] = [of(a), of(b)]; return (x < y ? -1 : x > y ? 1 : 0) * (up ? 1 : -1); });
  }
  body.replaceChildren(...cells.map(rowOf));
  document.getElementById("count").textContent = `${cells.length} of ${data.cells.length} cells`;
}

function rowOf(cell) {
  const button = make("button", { type: "button", "aria-expanded": "false" }, `${cell.room}/`, make("wbr"), cell.sequence.slice(cell.room.length + 1)), row = make("tr", {}, make("td", {}, button));
  for (const { name, k } of shown) row.append(make("td", { class: (data.numeric[k] ? "n" : "") + (main.includes(name) ? "" : " wide") }, cell.row[k]));
  row.children[1].append(make("span", { class: "narrow soft" }, ` ${cell.row[columns.indexOf("reference")]}`));
  button.addEventListener("click", () => {
    const open = button.getAttribute("aria-expanded") === "true";
    button.setAttribute("aria-expanded", String(!open));
    if (open) row.nextSibling.remove(); else row.after(make("tr", { class: "open" }, make("td", { colspan: shown.length + 1 }, opened(cell))));
  });
  return row;
}

function opened(cell) {
  const box = make("div", { class: "cell" }), figure = (content, text) => box.append(make("figure", {}, content, make("figcaption", {}, text)));
  if (cell.failed) box.append(make("p", {}, `Failed: ${cell.failed}`));
  if (cell.path) { figure(pathChart(cell.path, cell.odometer), "Trajectory: estimate in colour, ground truth in grey"); figure(errorChart(cell.path, cell.odometer), "Error over time"); }
  const picture = (name, text) => { if (cell[name]) figure(make("img", { src: cell[name], alt: `${text} of ${cell.name}`, width: 720, height: 540 }), text); };
  picture("heat_jpg", "Surface coloured by its distance to the model");
  if (cell.heat_jpg) box.lastChild.append(make("div", { class: "heat" }), make("span", { class: "soft" }, data.heat_text));
  picture("surface_jpg", "Surface in its fused colours");
  if (data.films[cell.sequence]) figure(make("video", { src: data.films[cell.sequence], controls: "", muted: "", loop: "", preload: "none" }), "The sequence: colour and depth");
  const list = make("dl"), pair = (name, text) => list.append(make("div", {}, make("dt", {}, name), make("dd", {}, text)));
  columns.forEach((name, k) => { if (cell.row[k]) pair(name, cell.row[k]); });
  for (const [name, text] of Object.entries(cell.more)) pair(name, text);
  box.append(list);
  return box;
}

for (const key of Object.keys(filters)) {
  const k = columns.indexOf(key), values = [...new Set(data.cells.map(c => c.row[k]))];
  if (values.length < 2) continue;
  const select = make("select", {}, make("option", { value: "" }, "all"), ...values.map(v => make("option", { value: v }, v)));
  select.addEventListener("change", () => { filters[key] = select.value; rows(); });
  document.getElementById("filters").append(make("label", {}, key, select));
}
search.addEventListener("input", rows);
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach(one => { one.dataset.was = one.open; one.open = true; }));
addEventListener("afterprint", () => document.querySelectorAll("details").forEach(one => { one.open = one.dataset.was === "true"; }));
header(); rows(); scatter();
