"use strict";
// Plots of curves can be zoomed and read: uPlot draws what the SVG of the page holds. Without a
// script, in a notebook and on paper the SVG itself is seen.
const HEIGHT_PX = 220;
const KEYS = ["+", "-", "ArrowLeft", "ArrowRight", "0"];
const STEP = 0.25;
const groups = new Map();

// From places of the SVG to numbers: "low,high,start,end" of an axis.
function axis(text) {
  const [low, high, start, end] = text.split(",").map(Number);
  return (place) => low + ((place - start) / (end - start)) * (high - low);
}

// One curve as two columns. Between two pieces stands a gap; x always grows.
function columns(pieces, toX, toY, least) {
  const xs = [];
  const ys = [];
  let last = -Infinity;
  const put = (x, y) => {
    last = x > last ? x : last + least;
    xs.push(last);
    ys.push(y);
  };
  pieces.forEach((points, k) => {
    if (k > 0) put(last, null);
    for (const [x, y] of points) put(toX(x), toY(y));
  });
  return [xs, ys];
}

function points(line) {
  return line.getAttribute("points").trim().split(/\s+/).map((pair) => pair.split(",").map(Number));
}

function grows(pieces) {
  const xs = pieces.flat().map(([x]) => x);
  return xs.every((x, k) => k === 0 || x >= xs[k - 1]);
}

// The curves of a plot by their label, or null where x does not grow along one of them.
function curves(svg) {
  const found = new Map();
  for (const line of svg.querySelectorAll("polyline")) {
    const key = `${line.dataset.label}|${line.getAttribute("class")}`;
    if (!found.has(key)) found.set(key, { label: line.dataset.label, line, pieces: [] });
    found.get(key).pieces.push(points(line));
  }
  const all = [...found.values()];
  return all.length && all.every((curve) => grows(curve.pieces)) ? all : null;
}

function colour(element) {
  return getComputedStyle(element).color;
}

function bands(svg, toX) {
  return [...svg.querySelectorAll("rect.band")].map((rect) => {
    const start = Number(rect.getAttribute("x"));
    const end = start + Number(rect.getAttribute("width"));
    return { start: toX(start), end: toX(end), colour: colour(rect) };
  });
}

function shade(plot, shaded) {
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.globalAlpha = 0.16;
  for (const band of shaded) {
    const from = Math.max(plot.valToPos(band.start, "x", true), bbox.left);
    const to = Math.min(plot.valToPos(band.end, "x", true), bbox.left + bbox.width);
    ctx.fillStyle = band.colour;
    if (to > from) ctx.fillRect(from, bbox.top, to - from, bbox.height);
  }
  ctx.restore();
}

// The same part of x in every plot of the page that has the same axis.
function together(plot, name) {
  const { min, max } = plot.scales.x;
  for (const other of groups.get(name)) {
    const { x } = other.scales;
    if (other !== plot && (x.min !== min || x.max !== max)) other.setScale("x", { min, max });
  }
}

// Where x begins and ends after a key; null: another key.
function moved(key, min, max, whole) {
  const size = max - min;
  if (key === "0") return whole;
  if (key === "+") return [min + STEP * size, max - STEP * size];
  if (key === "-") return [Math.max(min - size / 2, whole[0]), Math.min(max + size / 2, whole[1])];
  const way = key === "ArrowLeft" ? -STEP * size : STEP * size;
  const by = Math.min(Math.max(way, whole[0] - min), whole[1] - max);
  return [min + by, max + by];
}

// The part of y that is shown: what the curves fill, or all where they are flat.
function seen(min, max, lowest, highest) {
  return max > min ? uPlot.rangeNum(min, max, 0.1, true) : [lowest, highest];
}

function options(svg, found, width) {
  const text = colour(svg.querySelector("text"));
  const grid = { stroke: getComputedStyle(svg.querySelector(".grid") ?? svg).stroke, width: 1 };
  const toX = axis(svg.dataset.x);
  const shaded = bands(svg, toX);
  const [lowest, highest] = svg.dataset.y.split(",").map(Number);
  const name = svg.dataset.xLabel;
  const lines = found.map(({ label, line }) => ({ label: label || svg.dataset.yLabel, stroke: colour(line), width: 1.5 }));
  return {
    width,
    height: HEIGHT_PX,
    title: svg.dataset.yLabel,
    scales: { x: { time: false }, y: { range: (_, min, max) => seen(min, max, lowest, highest) } },
    cursor: { sync: { key: name }, drag: { x: true, y: false } },
    axes: [
      { label: name, labelSize: 18, stroke: text, grid },
      { size: 60, stroke: text, grid },
    ],
    series: [{ label: name }, ...lines],
    hooks: {
      drawClear: [(plot) => shade(plot, shaded)],
      setScale: [(plot, key) => { if (key === "x" && groups.get(name)?.includes(plot)) together(plot, name); }],
    },
  };
}

function live(figure) {
  const svg = figure.querySelector("svg[data-x]");
  const found = svg && curves(svg);
  if (!found) return;
  const toX = axis(svg.dataset.x);
  const toY = axis(svg.dataset.y);
  const [low, high] = svg.dataset.x.split(",").map(Number);
  const data = uPlot.join(found.map(({ pieces }) => columns(pieces, toX, toY, 1e-9 * (high - low))));
  const box = Object.assign(document.createElement("div"), { className: "zoom", tabIndex: 0 });
  box.setAttribute("role", "img");
  box.setAttribute("aria-label", `${svg.getAttribute("aria-label")}. Keys: + - arrows 0`);
  const plot = new uPlot(options(svg, found, svg.clientWidth || 400), data, box);
  svg.after(box);
  figure.classList.add("live");
  const name = svg.dataset.xLabel;
  groups.set(name, [...(groups.get(name) ?? []), plot]);
  box.addEventListener("keydown", (event) => {
    if (!KEYS.includes(event.key)) return;
    event.preventDefault();
    const { min, max } = plot.scales.x;
    const [from, to] = moved(event.key, min, max, [low, high]);
    plot.setScale("x", { min: from, max: to });
  });
  addEventListener("resize", () => plot.setSize({ width: box.clientWidth || 400, height: HEIGHT_PX }));
}

// A page inside another tells how high it is.
function tellHeight() {
  parent.postMessage({ height_px: document.documentElement.scrollHeight }, "*");
}

if (typeof document !== "undefined") {
  for (const figure of document.querySelectorAll("figure")) live(figure);
  if (parent !== window) {
    addEventListener("resize", tellHeight);
    addEventListener("load", tellHeight);
    document.addEventListener("toggle", tellHeight, true);
  }
} else {
  module.exports = { axis, columns, grows, moved };
}
