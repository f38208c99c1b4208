// The page's time, its keys and buttons, and what it asks the server for. One time for lanes, plots and 3-D views.
"use strict";

const PLOT_HEIGHT = 92, STORY_EVERY_MS = 1000, REACH_PX = 6, MOST_MS = 100, REST_MS = 150;
const byId = (id) => document.getElementById(id);
const view = { from: 0, to: 1, time: 0, hover: null, playing: false, shown: 0 };
const spaces = []; // the 3-D views
const SHOWN = ["planned", "forces", "moments"];
const plots = []; // {names, curves: name -> sides, box, canvas, legend}
let story = null, known = [], camera = null, scenes = null, asking = false, wanted = null, fetching = null, remembering = null;

const ask = async (path) => {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
};
const begin = () => Math.min(...story.sides.map((side) => side.begin_s + side.shift_s));
const end = () => Math.max(...story.sides.map((side) => side.end_s + side.shift_s));
const follows = () => story.sides[0].what === "live" && byId("follow").checked;
const tag = (number) => story.sides.length > 1 ? "AB"[number] + " " : "";
const events = (serious) => known.filter((event) => event.serious || !serious);

function takeStory(told) {
  story = told;
  known = story.sides
    .flatMap((side, n) => side.events.map((event) => ({ ...event, at: event.time_s + side.shift_s, tag: tag(n) })))
    .sort((a, b) => a.at - b.at);
}

// All of the time line: what is in it or its range has changed.
function draw() {
  drawLanes(byId("lanes"), story.sides, view, tag);
  for (const plot of plots) drawPlot(plot.canvas, curvesOf(plot), view, PLOT_HEIGHT);
  point();
}

// What moves with the time: cursors and values.
function point() {
  for (const canvas of [byId("lanes"), ...plots.map((plot) => plot.canvas)]) moveCursors(canvas, view);
  plots.forEach(tell);
  if (document.activeElement !== byId("time")) byId("time").value = view.time.toFixed(3);
}

function curvesOf(plot) {
  const found = [];
  plot.names.forEach((name, n) => {
    const sides = plot.curves[name] || [];
    const chosen = byId("difference").checked && sides.length > 2 ? sides.slice(2) : sides.slice(0, 2);
    chosen.forEach((side, i) => found.push({ ...side, colour: COLOURS[n % COLOURS.length], dash: i ? [4, 3] : [], name }));
  });
  return found;
}

// The value of a curve at a time: the last point that is not after it.
function valueAt(curve, time) {
  let low = 0, high = curve.time_s.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (curve.time_s[middle] + curve.shift_s <= time + 1e-9) low = middle + 1; else high = middle;
  }
  return low ? curve.high[low - 1] : null;
}

function tell(plot) {
  const time = view.hover === null ? view.time : view.hover, curves = curvesOf(plot);
  plot.names.forEach((name, n) => {
    const values = curves.filter((curve) => curve.name === name).map((curve) => valueAt(curve, time));
    const words = values.map((value) => value === null ? "–" : Number(value.toPrecision(5))).join(" / ");
    plot.legend.children[n].textContent = `${name} ${words} ✕`;
  });
}

// Moves the 3-D views; while one answer is awaited only the newest wish is kept.
async function showAt(time) {
  wanted = time;
  if (asking) return;
  asking = true;
  while (wanted !== null) {
    const path = wanted === "newest" ? "/at" : `/at?time_s=${wanted}&span_s=${view.to - view.from}`;
    wanted = null;
    try {
      const sides = await ask(path);
      if (path === "/at") view.time = sides[0].time_s, moveRange(sides[0].time_s);
      byId("captions").textContent = sides.map((side) => side.lines.join("\n")).join("\n\n");
      show(sides);
    } catch (error) {
      byId("captions").textContent = "the viewer has ended";
      pause();
    }
  }
  asking = false;
  point();
}

function show(sides) {
  const moved = view.moments && less(sides[0].body, view.moments[0].body);
  view.moments = sides;
  if (moved && byId("follows").checked) camera.target = add(camera.target, moved);
  spaces.forEach((space, n) => space.show(sides[n]));
  view.shown += 1;
}

// Looks from one of the scene's places at the body, or at a gripper.
function look(name) {
  const side = view.moments[0], gripper = scenes[0].grippers.indexOf(name);
  camera.look(gripper < 0 ? side.body : side.grippers.slice(3 * gripper, 3 * gripper + 3), scenes[0].cameras[name]);
}

function moveRange(time) {
  const width = view.to - view.from;
  if (time > view.to || time < view.from) [view.from, view.to] = [time - width * 0.9, time + width * 0.1], fetchSoon(), draw();
}

function seek(time) {
  byId("follow").checked = false;
  view.time = Math.min(Math.max(time, begin()), end());
  moveRange(view.time);
  markEvent();
  showAt(view.time);
  point();
  if (!view.playing) remember();
}

// In the address, when the hand has come to rest: browsers refuse to be told hundreds of addresses.
function remember() {
  clearTimeout(remembering);
  remembering = setTimeout(rememberNow, REST_MS);
}

function rememberNow() {
  const words = plots.map((plot) => plot.names.join(",")).join(";");
  const hash = `t=${view.time.toFixed(3)}&from=${view.from.toFixed(3)}&to=${view.to.toFixed(3)}&plots=${words}`;
  history.replaceState(null, "", "#" + hash);
}

function pause() { view.playing = false; byId("play").textContent = "play"; remember(); }

function play() {
  if (view.playing) { pause(); return; }
  view.playing = true;
  byId("play").textContent = "pause";
  let last = performance.now();
  const step = (now) => {
    if (!view.playing) return;
    const passed_ms = Math.min(now - last, MOST_MS); // a machine that draws slowly plays slowly, and leaves nothing out
    const time = view.time + passed_ms / 1000 * Number(byId("speed").value);
    last = now;
    seek(time);
    if (time >= end()) pause(); else requestAnimationFrame(step);
  };
  if (view.time >= end() - 1e-6) seek(begin());
  requestAnimationFrame(step);
}

function jump(way, serious) {
  const found = events(serious).filter((event) => way > 0 ? event.at > view.time + 1e-4 : event.at < view.time - 1e-4);
  if (found.length) seek(way > 0 ? found[0].at : found[found.length - 1].at);
}

function setRange(from, to) {
  const least = 4 * story.sides[0].step_s;
  if (to - from < least) return;
  [view.from, view.to] = [from, to];
  fetchSoon();
  draw();
  remember();
}

function fetchSoon() {
  clearTimeout(fetching);
  fetching = setTimeout(fetchCurves, 60);
}

async function fetchCurves() {
  const points = Math.max(100, Math.round(byId("lanes").clientWidth / 2));
  await Promise.all(plots.flatMap((plot) => plot.names.map(async (name) => {
    const query = new URLSearchParams({ name, from_s: view.from, to_s: view.to, points });
    plot.curves[name] = await ask("/signal?" + query);
  })));
  draw();
}

function addPlot(names) {
  const box = document.createElement("div"), canvas = document.createElement("canvas");
  const legend = document.createElement("div");
  box.className = "plot";
  legend.className = "names";
  box.append(canvas, legend);
  byId("plots").insertBefore(box, byId("plots").lastElementChild);
  const plot = { names: [], curves: {}, box, canvas, legend };
  plots.push(plot);
  addCursors(canvas);
  pointAt(canvas);
  takeDrops(box, (name) => addSignal(plot, name));
  names.forEach((name) => addSignal(plot, name));
}

function addSignal(plot, name) {
  if (!story.signals.includes(name) || plot.names.includes(name)) return;
  plot.names.push(name);
  const label = document.createElement("b");
  label.style.color = COLOURS[(plot.names.length - 1) % COLOURS.length];
  label.title = "click: takes it out";
  label.onclick = () => removeSignal(plot, name);
  plot.legend.append(label);
  fetchSoon();
}

function removeSignal(plot, name) {
  const left = plot.names.filter((other) => other !== name);
  plots.splice(plots.indexOf(plot), 1);
  plot.box.remove();
  if (left.length) addPlot(left);
  draw();
  remember();
}

function takeDrops(box, take) {
  box.ondragover = (event) => { event.preventDefault(); box.classList.add("over"); };
  box.ondragleave = () => box.classList.remove("over");
  box.ondrop = (event) => {
    event.preventDefault();
    box.classList.remove("over");
    take(event.dataTransfer.getData("text/plain"));
    remember();
  };
}

// Click and drag: time. With shift, drag: the range. Wheel: zoom about the pointer.
function pointAt(canvas) {
  let held = null;
  const timeOf = (event) => clock(canvas, view).time(event.offsetX);
  canvas.onpointerdown = (event) => {
    held = { time: timeOf(event), from: view.from, to: view.to, moves: event.shiftKey };
    canvas.setPointerCapture(event.pointerId);
    if (!held.moves) seek(nearEvent(canvas, event));
  };
  canvas.onpointermove = (event) => {
    view.hover = event.offsetX > GUTTER ? timeOf(event) : null;
    if (held && held.moves) setRange(view.from + held.time - timeOf(event), view.to + held.time - timeOf(event));
    else if (held) seek(timeOf(event));
    else point();
  };
  canvas.onpointerup = () => { held = null; };
  canvas.onpointerleave = () => { view.hover = null; point(); };
  canvas.onwheel = (event) => {
    event.preventDefault();
    const at = timeOf(event), factor = Math.exp(event.deltaY / 400);
    setRange(at - (at - view.from) * factor, at + (view.to - at) * factor);
  };
  canvas.ondblclick = whole;
}

// The time clicked on, or the event's that lies there.
function nearEvent(canvas, event) {
  const at = clock(canvas, view);
  const near = events(false).find((told) => Math.abs(at.x(told.at) - event.offsetX) < REACH_PX && event.offsetY < ROW);
  return near ? near.at : at.time(event.offsetX);
}

const whole = () => setRange(begin(), Math.max(end(), begin() + 1));

function listEvents() {
  const box = byId("events");
  if (box.childElementCount === known.length) return;
  box.replaceChildren(...known.map((event) => {
    const line = document.createElement("div");
    line.textContent = `${event.at.toFixed(3)}  ${event.tag}${event.text}`;
    line.className = event.serious ? "serious" : "";
    line.onclick = () => seek(event.at);
    return line;
  }));
  markEvent();
}

function markEvent() {
  const box = byId("events"), now = known.findLastIndex((event) => event.at <= view.time + 1e-4);
  if (box.now === box.children[now]) return;
  if (box.now) box.now.classList.remove("now");
  box.now = box.children[now];
  if (!box.now) return;
  box.now.classList.add("now");
  box.scrollTop = box.now.offsetTop - box.offsetTop - 60;
}

function listSignals() {
  const words = byId("filter").value.toLowerCase().split(/\s+/);
  const found = story.signals.filter((name) => words.every((word) => name.toLowerCase().includes(word)));
  byId("signals").replaceChildren(...found.map((name) => {
    const line = document.createElement("div");
    line.textContent = name;
    line.draggable = true;
    line.ondragstart = (event) => event.dataTransfer.setData("text/plain", name);
    line.ondblclick = () => { addPlot([name]); remember(); };
    return line;
  }));
}

const step = (cycles) => seek(view.time + cycles * story.sides[0].step_s);
const faster = (way) => { byId("speed").selectedIndex = Math.min(Math.max(byId("speed").selectedIndex + way, 0), 6); };
const KEYS = {
  " ": play, ArrowLeft: (event) => event.shiftKey ? seek(view.time - 1) : step(-1),
  ArrowRight: (event) => event.shiftKey ? seek(view.time + 1) : step(1), n: () => jump(1), p: () => jump(-1),
  f: () => jump(1, true), F: () => jump(-1, true), "+": () => faster(1), "-": () => faster(-1), 0: whole,
  Home: () => seek(begin()), End: () => seek(end()),
};

function listen() {
  byId("play").onclick = play;
  byId("back").onclick = () => step(-1);
  byId("forth").onclick = () => step(1);
  byId("previous").onclick = () => jump(-1);
  byId("next").onclick = () => jump(1);
  byId("fault").onclick = () => jump(1, true);
  byId("all").onclick = whole;
  byId("link").onclick = () => { rememberNow(); navigator.clipboard.writeText(location.href); };
  byId("time").onchange = () => seek(Number(byId("time").value) || 0);
  byId("difference").onchange = draw;
  byId("filter").oninput = listSignals;
  for (const name of SHOWN) byId(name).onchange = () => spaces.forEach((space) => space.soon());
  Object.keys(scenes[0].cameras).forEach((name, i) => {
    const button = document.createElement("button");
    button.textContent = name;
    button.onclick = () => look(name);
    byId("cameras").append(button);
    KEYS[i + 1] = () => look(name);
  });
  document.onkeydown = (event) => {
    if (event.target.tagName === "INPUT" && event.target.type !== "checkbox") return;
    const act = event.ctrlKey || event.metaKey || event.altKey ? null : KEYS[event.key];
    if (act) { event.preventDefault(); document.activeElement.blur(); act(event); }
  };
  window.onresize = () => { fetchSoon(); draw(); };
  window.onhashchange = recall;
}

function recall() {
  const said = new URLSearchParams(location.hash.slice(1));
  const number = (name, otherwise) => said.get(name) === null ? otherwise : Number(said.get(name)) || 0;
  const live = story.sides[0].what === "live";
  view.from = number("from", live ? end() - 20 : begin());
  view.to = number("to", live ? end() + 10 : Math.max(end(), begin() + 1));
  const wish = said.get("plots") || story.signals.filter((name) => name.startsWith("margin_n")).join(",") + ";body_error_mm";
  while (plots.length) plots.pop().box.remove();
  wish.split(";").filter(Boolean).forEach((names) => addPlot(names.split(",")));
  view.time = number("t", begin());
}

async function main() {
  takeStory(await ask("/story"));
  byId("names").textContent = story.sides.map((side) => side.name).join(" and ");
  byId("following").hidden = story.sides[0].what !== "live";
  byId("differing").hidden = story.sides.length < 2;
  scenes = await ask("/scene");
  camera = new Camera(scenes[0].up);
  scenes.forEach((scene) => {
    const box = document.createElement("div");
    byId("views").append(box);
    spaces.push(new Space(box, scene, camera, (name) => byId(name).checked));
  });
  const empty = document.createElement("div");
  empty.className = "empty";
  empty.textContent = "drop a signal here for a new plot";
  byId("plots").append(empty);
  takeDrops(empty, (name) => addPlot([name]));
  listen();
  listSignals();
  addCursors(byId("lanes"));
  pointAt(byId("lanes"));
  recall();
  listEvents();
  show(await ask(`/at?time_s=${view.time}&span_s=${view.to - view.from}`));
  look("overview");
  if (story.sides[0].what === "live") live(); else seek(view.time);
  view.connected = true;
}

async function live() {
  setInterval(() => { if (follows()) showAt("newest"); }, 40);
  setInterval(async () => {
    takeStory(await ask("/story"));
    listEvents();
    fetchSoon();
  }, STORY_EVERY_MS);
}

main();
