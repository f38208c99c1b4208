// The plots: which signals each shows, as courses over time or one against the other, and what the mouse does on them.
import { ask, byId, element, events, page, view } from "./state.js";
import { addCursors, clock, COLOURS, drawLanes, drawPlot, drawXY, GUTTER, moveCursors, ROW, rangeOf, XY_POINTS } from "./drawing.js";
import { icon } from "./icons.js";
import { remember, seek, setRange, whole } from "./timeline.js";
import { tag } from "./state.js";

const PLOT_HEIGHT = 92, XY_HEIGHT = 240, REACH_PX = 6, FETCH_MS = 60;
export const plots = []; // {names, xy, low, high, curves: name -> sides, box, canvas, legend}
let fetching = null;

// All of the time line: what is in it or its range has changed.
export function draw() {
  drawLanes(byId("lanes"), page.story.sides, view, tag);
  plots.forEach(drawOne);
  point();
}

function drawOne(plot) {
  const unit = [...new Set(plot.names.slice(plot.xy ? 1 : 0).map((name) => page.story.signals[name]))].join(", ");
  if (plot.xy) drawXY(plot.canvas, pairsOf(plot), view, XY_HEIGHT, [plot.names[0], page.story.signals[plot.names[0]]], unit);
  else drawPlot(plot.canvas, curvesOf(plot), view, PLOT_HEIGHT, unit, plot);
}

// What moves with the time: cursors, values and the dot of an XY plot.
export function point() {
  moveCursors(byId("lanes"), view);
  for (const plot of plots) if (plot.xy) drawOne(plot); else moveCursors(plot.canvas, view);
  plots.forEach(tellValues);
  if (document.activeElement !== byId("time")) byId("time").value = view.time.toFixed(3);
}

// Of two logs the first dashed by nothing, the second dashed; or their difference.
function sidesOf(plot, name) {
  const sides = plot.curves[name] || [];
  return byId("difference").checked && sides.length > 2 ? sides.slice(2) : sides.slice(0, 2);
}

const curvesOf = (plot) => plot.names.flatMap((name, n) => sidesOf(plot, name).map((side, i) => (
  { ...side, colour: COLOURS[n % COLOURS.length], dash: i ? [4, 3] : [], name })));

function pairsOf(plot) {
  const across = sidesOf(plot, plot.names[0]);
  return plot.names.slice(1).flatMap((name, n) => sidesOf(plot, name).filter((_, i) => across[i]).map((side, i) => (
    { ...side, across: across[i], colour: COLOURS[(n + 1) % COLOURS.length], dash: i ? [4, 3] : [], name })));
}

// The value of a curve at a time: the last point that is not after it.
function valueAt(curve, time) {
  const at = curve.time_s.findLastIndex((t) => t + curve.shift_s <= time + 1e-9);
  return at < 0 ? null : curve.high[at];
}

function tellValues(plot) {
  const time = view.hover === null ? view.time : view.hover;
  plot.names.forEach((name, n) => {
    const values = sidesOf(plot, name).map((curve) => valueAt(curve, time));
    const words = values.map((value) => value === null ? "–" : Number(value.toPrecision(5))).join(" / ");
    plot.legend.children[n].firstChild.textContent = `${name} ${words} ${page.story.signals[name]}`;
  });
}

export function fetchSoon() {
  clearTimeout(fetching);
  fetching = setTimeout(fetchCurves, FETCH_MS);
}

export async function signal(name, points) {
  return ask("/signal?" + new URLSearchParams({ name, from_s: view.from, to_s: view.to, points }));
}

async function fetchCurves() {
  const points = Math.max(100, Math.round(byId("lanes").clientWidth / 2));
  page.spaces.forEach((space) => space.trails.stale());
  await Promise.all(plots.flatMap((plot) => plot.names.map(async (name) => {
    plot.curves[name] = await signal(name, plot.xy ? XY_POINTS : points);
  })));
  draw();
}

export const plotsAsWords = () => plots.map((plot) => (plot.xy ? "xy:" : "") + plot.names.join(",")).join(";");

export function takePlots(words) {
  while (plots.length) plots.pop().box.remove();
  for (const said of words.split(";").filter(Boolean)) addPlot(said.replace(/^xy:/, "").split(","), said.startsWith("xy:"));
}

export function addPlot(names, xy = false) {
  const canvas = element("canvas"), legend = element("div", "names"), way = element("button", "xy", "", icon("xy"));
  const box = element("div", "plot", "", legend, canvas, way);
  byId("plots").insertBefore(box, byId("plots").lastElementChild);
  const plot = { names: [], xy: false, low: null, high: null, curves: {}, box, canvas, legend, way };
  plots.push(plot);
  addCursors(canvas);
  pointAt(canvas, plot);
  takeDrops(box, (name) => addSignal(plot, name));
  way.title = "the first signal across, the others up; again: over time";
  way.onclick = () => { setXY(plot, !plot.xy); remember(); };
  names.forEach((name) => addSignal(plot, name));
  if (!plot.names.length) removePlot(plot); else setXY(plot, xy && plot.names.length > 1);
}

function setXY(plot, xy) {
  plot.xy = xy;
  plot.box.classList.toggle("across", xy);
  fetchSoon();
}

function addSignal(plot, name) {
  if (!(name in page.story.signals) || plot.names.includes(name)) return;
  plot.names.push(name);
  const label = element("b", "", "", element("span"), icon("close"));
  label.style.color = COLOURS[(plot.names.length - 1) % COLOURS.length];
  label.title = "click: remove";
  label.onclick = () => removeSignal(plot, name);
  plot.legend.append(label);
  plot.way.hidden = plot.names.length < 2;
  fetchSoon();
}

function removePlot(plot) {
  plots.splice(plots.indexOf(plot), 1);
  plot.box.remove();
}

function removeSignal(plot, name) {
  const left = plot.names.filter((other) => other !== name);
  removePlot(plot);
  if (left.length) addPlot(left, plot.xy);
  draw();
  remember();
}

export function takeDrops(box, take) {
  box.ondragover = (event) => { event.preventDefault(); box.classList.add("over"); };
  box.ondragleave = () => box.classList.remove("over");
  box.ondrop = (event) => {
    event.preventDefault();
    box.classList.remove("over");
    take(event.dataTransfer.getData("text/plain"));
    remember();
  };
}

// Zooms the axis of values about what is at `y`; without a factor it is as the curves need it again.
function zoomValues(plot, y, factor) {
  if (factor === null) [plot.low, plot.high] = [null, null];
  else {
    const range = rangeOf(curvesOf(plot), plot), at = range.value(y, PLOT_HEIGHT);
    [plot.low, plot.high] = [at - (at - range.low) * factor, at + (range.high - at) * factor];
  }
  draw();
}

// Click and drag: time. With shift, drag: the range. Wheel or two fingers: zoom about the pointer. On the axis of values,
// or with ctrl: those.
export function pointAt(canvas, plot = null) {
  let held = null;
  const fingers = new Map();
  const timeOf = (event) => clock(canvas, view).time(event.offsetX);
  const onAxis = (event) => plot && !plot.xy && event.offsetX < GUTTER;
  const gap = () => { const [a, b] = [...fingers.values()]; return Math.max(Math.abs(a - b), 10); };
  const zoom = (at, factor) => setRange(at - (at - view.from) * factor, at + (view.to - at) * factor);
  canvas.onpointerdown = (event) => {
    fingers.set(event.pointerId, event.offsetX);
    held = { time: timeOf(event), from: view.from, to: view.to, moves: event.shiftKey, y: event.offsetY, axis: onAxis(event) };
    canvas.setPointerCapture(event.pointerId);
    if (!held.moves && !held.axis && !plot?.xy && fingers.size === 1) seek(nearEvent(canvas, event));
  };
  canvas.onpointermove = (event) => {
    if (plot?.xy) return;
    view.hover = event.offsetX > GUTTER ? timeOf(event) : null;
    if (fingers.size === 2 && fingers.has(event.pointerId)) {
      const before = gap();
      fingers.set(event.pointerId, event.offsetX);
      zoom((view.from + view.to) / 2, before / gap());
    } else if (held && held.axis) {
      const range = rangeOf(curvesOf(plot), plot), moved = range.value(held.y, PLOT_HEIGHT) - range.value(event.offsetY, PLOT_HEIGHT);
      [plot.low, plot.high, held.y] = [range.low + moved, range.high + moved, event.offsetY];
      draw();
    } else if (held && held.moves) setRange(view.from + held.time - timeOf(event), view.to + held.time - timeOf(event));
    else if (held) seek(timeOf(event));
    else point();
  };
  canvas.onpointerup = canvas.onpointercancel = (event) => { held = null; fingers.delete(event.pointerId); };
  canvas.onpointerleave = () => { view.hover = null; point(); };
  canvas.onwheel = (event) => {
    event.preventDefault();
    const factor = Math.exp(event.deltaY / 400);
    if (plot && !plot.xy && (onAxis(event) || event.ctrlKey)) zoomValues(plot, event.offsetY, factor);
    else zoom(timeOf(event), factor);
  };
  canvas.ondblclick = (event) => onAxis(event) ? zoomValues(plot, 0, null) : whole();
}

// The time clicked on, or the event's that lies there.
function nearEvent(canvas, event) {
  const at = clock(canvas, view);
  const near = events(false).find((told) => Math.abs(at.x(told.at) - event.offsetX) < REACH_PX && event.offsetY < ROW);
  return near ? near.at : at.time(event.offsetX);
}
