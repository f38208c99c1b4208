// Draws lanes and plots on canvases that share one range of time, and cursors over them. Knows nothing of where data come from.
import { colour } from "./theme.js";

export const GUTTER = 80, ROW = 17, XY_POINTS = 4000;
const RIGHT = 8, AXIS = 18, ROOM = 7, FOOT = 6; // above and below curves
export const COLOURS = ["#3b82d6", "#e08a2e", "#35a565", "#d2527f", "#9a72d8", "#35aabf", "#a98b4a", "#8a8f98"];
const SPANS = {
  state: { IDLE: "#c9ccd1", READY: "#a9c6ea", CLIMBING: "#8fce9f", HOLDING: "#f2d27a", FAULT: "#e0566a" },
  gait: { stance: "#5b7f9f", unload: "#a9bfd1", open: "#e6c690", lift: "#f0a95b", swing: "#f08a3c", descend: "#f0a95b", close: "#e6c690", load: "#a9bfd1" },
};
const WAIT = "#b89ad6", SLIP_WAIT = "#d0407a";

export function clock(canvas, range) {
  const width = (canvas.span || canvas.clientWidth) - GUTTER - RIGHT; // asking would make the browser lay out the page
  return {
    x: (time) => GUTTER + (time - range.from) / (range.to - range.from) * width,
    time: (x) => range.from + (x - GUTTER) / width * (range.to - range.from),
  };
}

function fresh(canvas, height) {
  const ratio = window.devicePixelRatio || 1, width = canvas.span = canvas.clientWidth;
  canvas.style.height = height + "px";
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d", { willReadFrequently: true }); // drawn by the processor: without a graphics card that is far quicker
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "11px system-ui, sans-serif";
  pen.textBaseline = "middle";
  return pen;
}

// Round numbers between two, some `count` of them.
function ticks(low, high, count) {
  const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const found = [];
  for (let value = Math.ceil(low / step) * step; value <= high + step * 1e-9; value += step)
    found.push(Number(value.toPrecision(12)));
  return found;
}

// Lines over a canvas, which need not be drawn again when they move. Its parent is what they lie in.
export function addCursors(canvas) {
  canvas.cursors = ["hover", "cursor"].map((kind) => {
    const line = document.createElement("i");
    line.className = kind;
    canvas.after(line);
    return line;
  });
}

export function moveCursors(canvas, view) {
  const at = clock(canvas, view);
  [view.hover, view.time].forEach((when, n) => {
    const x = when === null ? -1 : at.x(when), hidden = x < GUTTER || x > canvas.span;
    canvas.cursors[n].style.transform = `translateX(${hidden ? -9 : Math.round(x)}px)`;
  });
}

function drawSpan(pen, at, lane, span, shift, y) {
  const [begin, end, word] = span;
  const left = Math.max(at.x(begin + shift), GUTTER), right = Math.max(at.x(end + shift), left + 1);
  if (at.x(end + shift) < GUTTER) return;
  pen.fillStyle = lane.kind === "wait" ? (word.endsWith("slip") ? SLIP_WAIT : WAIT) : SPANS[lane.kind][word] || "#bbb";
  pen.fillRect(left, y + 1, right - left, ROW - 2);
  if (right - left < pen.measureText(word).width + 6) return;
  pen.fillStyle = word === "stance" ? "#fff" : "#1c232b";
  pen.fillText(word, left + 3, y + ROW / 2);
}

// Events, then the lanes of every side, then the axis. `view`: from, to, time, hover; `tag`: what a side is called.
export function drawLanes(canvas, sides, view, tag) {
  const rows = sides.reduce((sum, side) => sum + side.lanes.length + 1, 0);
  const height = rows * ROW + AXIS, pen = fresh(canvas, height), at = clock(canvas, view);
  let y = 0;
  sides.forEach((side, number) => {
    for (const lane of [{ name: "events", spans: [] }, ...side.lanes]) {
      pen.fillStyle = colour("text");
      pen.fillText(tag(number) + lane.name, 6, y + ROW / 2);
      if (lane.name === "events")
        for (const event of side.events) {
          const x = at.x(event.time_s + side.shift_s);
          if (x < GUTTER) continue;
          pen.fillStyle = colour(event.serious ? "bad" : "muted");
          pen.fillRect(x - 1, y + (event.serious ? 1 : 5), 2, ROW - (event.serious ? 2 : 6));
        }
      for (const span of lane.spans) drawSpan(pen, at, lane, span, side.shift_s, y);
      y += ROW;
    }
  });
  pen.fillStyle = colour("muted");
  for (const tick of ticks(view.from, view.to, Math.max(2, canvas.span / 130))) {
    pen.fillRect(at.x(tick), y, 1, 5);
    pen.fillText(tick + " s", at.x(tick) + 3, y + 10);
  }
}

// A curve as the least and largest of each interval, so that a spike of one cycle is seen at any zoom.
function drawCurve(pen, at, y, curve) {
  pen.beginPath();
  let going = false;
  curve.time_s.forEach((time, i) => {
    if (curve.low[i] === null) { going = false; return; }
    const x = at.x(time + curve.shift_s);
    if (going) pen.lineTo(x, y(curve.low[i])); else pen.moveTo(x, y(curve.low[i]));
    pen.lineTo(x, y(curve.high[i]));
    going = true;
  });
  pen.stroke();
}

// Of the values that curves have, or that `zoom` asks for; `y` and `value` are for a canvas of a height.
export function rangeOf(curves, zoom) {
  let { low, high } = zoom;
  if (low === null) {
    [low, high] = [Infinity, -Infinity];
    for (const curve of curves)
      curve.time_s.forEach((_, i) => {
        if (curve.low[i] === null) return;
        low = Math.min(low, curve.low[i]);
        high = Math.max(high, curve.high[i]);
      });
    if (low > high) [low, high] = [0, 1];
    if (high - low < 1e-9 * Math.max(1, Math.abs(high))) [low, high] = [low - 0.5, high + 0.5];
  }
  const share = (height) => (height - FOOT - ROOM) / (high - low);
  return {
    low, high,
    y: (value, height) => height - FOOT - (value - low) * share(height),
    value: (y, height) => low + (height - FOOT - y) / share(height),
  };
}

// Lines and numbers of the axis of values, and its unit.
function drawAxis(pen, canvas, range, height, unit) {
  for (const tick of ticks(range.low, range.high, height / 28)) {
    const y = range.y(tick, height);
    pen.fillStyle = colour("grid");
    pen.fillRect(GUTTER, y, canvas.span - GUTTER - RIGHT, 1);
    pen.fillStyle = colour("muted");
    pen.textAlign = "right";
    pen.fillText(String(tick), GUTTER - 6, Math.min(Math.max(y, 6), height - 7));
    pen.textAlign = "left";
  }
  pen.fillStyle = colour("text");
  pen.fillText(unit ? `[${unit}]` : "", 6, 9);
}

function clipped(pen, canvas, height, act) {
  pen.save();
  pen.beginPath();
  pen.rect(GUTTER, 0, canvas.span - GUTTER - RIGHT, height);
  pen.clip();
  act();
  pen.setLineDash([]);
  pen.restore();
}

// `curves`: {colour, dash, time_s, low, high, shift_s}; `zoom`: low and high, or null for all of them.
export function drawPlot(canvas, curves, view, height, unit, zoom) {
  const pen = fresh(canvas, height), at = clock(canvas, view), range = rangeOf(curves, zoom);
  drawAxis(pen, canvas, range, height, unit);
  clipped(pen, canvas, height, () => {
    for (const curve of curves) {
      pen.strokeStyle = curve.colour;
      pen.lineWidth = 1.3;
      pen.setLineDash(curve.dash);
      drawCurve(pen, at, (value) => range.y(value, height), curve);
    }
  });
}

// `pairs`: curves with `across`, the course at the same times that is drawn along x; a dot where the time is.
export function drawXY(canvas, pairs, view, height, [name, unitAcross], unit) {
  const pen = fresh(canvas, height), all = { low: null, high: null };
  const up = rangeOf(pairs, all), across = rangeOf(pairs.map((pair) => pair.across), all);
  const width = canvas.span - GUTTER - RIGHT, inner = height - AXIS;
  const x = (value) => GUTTER + 4 + (value - across.low) / (across.high - across.low) * (width - 8);
  drawAxis(pen, canvas, up, inner, unit);
  for (const tick of ticks(across.low, across.high, Math.max(2, canvas.span / 130))) {
    pen.fillStyle = colour("grid");
    pen.fillRect(x(tick), ROOM, 1, inner - ROOM);
    pen.fillStyle = colour("muted");
    pen.fillText(String(tick), x(tick) + 3, height - 9);
  }
  pen.fillStyle = colour("text");
  pen.textAlign = "right";
  pen.fillText(`${name}${unitAcross ? ` [${unitAcross}]` : ""}`, canvas.span - RIGHT - 4, inner - 8);
  pen.textAlign = "left";
  clipped(pen, canvas, inner, () => pairs.forEach((pair) => drawPair(pen, pair, x, (value) => up.y(value, inner), view.time)));
}

function drawPair(pen, pair, x, y, time) {
  const middle = (curve, i) => curve.low[i] === null ? null : (curve.low[i] + curve.high[i]) / 2;
  let going = false, dot = null;
  pen.strokeStyle = pen.fillStyle = pair.colour;
  pen.lineWidth = 1.3;
  pen.setLineDash(pair.dash);
  pen.beginPath();
  for (let i = 0; i < Math.min(pair.time_s.length, pair.across.time_s.length); i++) {
    const [a, b] = [middle(pair.across, i), middle(pair, i)];
    if (a === null || b === null) { going = false; continue; }
    if (going) pen.lineTo(x(a), y(b)); else pen.moveTo(x(a), y(b));
    going = true;
    if (pair.time_s[i] + pair.shift_s <= time + 1e-9) dot = [x(a), y(b)];
  }
  pen.stroke();
  if (!dot) return;
  pen.beginPath();
  pen.arc(...dot, 5, 0, 2 * Math.PI);
  pen.fill();
}
