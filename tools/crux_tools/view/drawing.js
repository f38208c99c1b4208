// Draws lanes and plots on canvases that share one range of time, and cursors over them. Knows nothing of where data come from.
"use strict";

const GUTTER = 80, RIGHT = 8, ROW = 15, AXIS = 16;
const COLOURS = ["#2465b0", "#d9822b", "#2a9d58", "#b5305f", "#7a4fbf", "#3aa6b9", "#8c6d31", "#555555"];
const SPANS = {
  state: { IDLE: "#c9ccd1", READY: "#a9c6ea", CLIMBING: "#8fce9f", HOLDING: "#f2d27a", FAULT: "#e0566a" },
  gait: { stance: "#5b7f9f", unload: "#a9bfd1", open: "#e6c690", lift: "#f0a95b", swing: "#f08a3c", descend: "#f0a95b", close: "#e6c690", load: "#a9bfd1" },
};
const WAIT = "#b89ad6", SLIP_WAIT = "#d0407a";

function clock(canvas, range) {
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
function addCursors(canvas) {
  canvas.cursors = ["hover", "cursor"].map((kind) => {
    const line = document.createElement("i");
    line.className = kind;
    canvas.after(line);
    return line;
  });
}

function moveCursors(canvas, view) {
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
  pen.fillStyle = word === "stance" ? "#fff" : "#222";
  pen.fillText(word, left + 3, y + ROW / 2);
}

// Events, then the lanes of every side, then the axis. `view`: from, to, time, hover; `tag`: what a side is called.
function drawLanes(canvas, sides, view, tag) {
  const rows = sides.reduce((sum, side) => sum + side.lanes.length + 1, 0);
  const height = rows * ROW + AXIS, pen = fresh(canvas, height), at = clock(canvas, view);
  let y = 0;
  sides.forEach((side, number) => {
    for (const lane of [{ name: "events", spans: [] }, ...side.lanes]) {
      pen.fillStyle = "#222";
      pen.fillText(tag(number) + lane.name, 6, y + ROW / 2);
      if (lane.name === "events")
        for (const event of side.events) {
          const x = at.x(event.time_s + side.shift_s);
          if (x < GUTTER) continue;
          pen.fillStyle = event.serious ? "#d0021b" : "#6b7a8c";
          pen.fillRect(x - 1, y + (event.serious ? 1 : 5), 2, ROW - (event.serious ? 2 : 6));
        }
      for (const span of lane.spans) drawSpan(pen, at, lane, span, side.shift_s, y);
      y += ROW;
    }
  });
  pen.fillStyle = "#555";
  for (const tick of ticks(view.from, view.to, 10)) {
    pen.fillRect(at.x(tick), y, 1, 4);
    pen.fillText(tick + " s", at.x(tick) + 3, y + 8);
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

// `curves`: {colour, dash, time_s, low, high, shift_s}.
function drawPlot(canvas, curves, view, height) {
  const pen = fresh(canvas, height), at = clock(canvas, view);
  let low = Infinity, high = -Infinity;
  for (const curve of curves)
    curve.time_s.forEach((_, i) => {
      if (curve.low[i] === null) return;
      low = Math.min(low, curve.low[i]);
      high = Math.max(high, curve.high[i]);
    });
  if (low > high) [low, high] = [0, 1];
  if (high - low < 1e-9 * Math.max(1, Math.abs(high))) [low, high] = [low - 0.5, high + 0.5];
  const room = 14, y = (value) => height - 4 - (value - low) / (high - low) * (height - 4 - room);
  pen.lineWidth = 1;
  for (const tick of ticks(low, high, 4)) {
    pen.fillStyle = "#eee";
    pen.fillRect(GUTTER, y(tick), canvas.clientWidth - GUTTER - RIGHT, 1);
    pen.fillStyle = "#555";
    pen.fillText(String(tick), 6, Math.max(y(tick), 6));
  }
  pen.save();
  pen.beginPath();
  pen.rect(GUTTER, 0, canvas.clientWidth - GUTTER - RIGHT, height);
  pen.clip();
  for (const curve of curves) {
    pen.strokeStyle = curve.colour;
    pen.setLineDash(curve.dash);
    drawCurve(pen, at, y, curve);
  }
  pen.setLineDash([]);
  pen.restore();
}
