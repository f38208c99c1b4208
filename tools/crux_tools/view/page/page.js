// Puts the page together: asks for story and scene, then listens to keys, buttons and the server.
import { ask, begin, byId, element, end, isLive, page, takeStory, tell, view } from "./state.js";
import { onTheme, toggleTheme } from "./theme.js";
import { putIcons } from "./icons.js";
import { draw, fetchSoon, plots, point, pointAt, addPlot, takeDrops, takePlots } from "./plots.js";
import { addCursors } from "./drawing.js";
import { faster, follows, jump, play, rememberNow, seek, setRange, show, showAt, step, whole } from "./timeline.js";
import { listEvents, listSignals, showJoints, showLegend } from "./panels.js";
import { listenLayouts } from "./layouts.js";
import { Space } from "./space.js";
import { Rig } from "./stage.js";

const STORY_EVERY_MS = 1000, NEWEST_EVERY_MS = 40, BEHIND_S = 20, AHEAD_S = 10;

const press = (id) => () => byId(id).click();
const KEYS = [ // keys, what they do in words, and what they do
  [[" "], "play or pause", play],
  [["ArrowLeft", "ArrowRight"], "one step back or forward; with shift 1 s", (event) => {
    const way = event.key === "ArrowLeft" ? -1 : 1;
    if (event.shiftKey) seek(view.time + way); else step(way);
  }],
  [["n", "p"], "next event, previous event", (event) => jump(event.key === "n" ? 1 : -1)],
  [["f", "F"], "next, previous fault, slip or refusal", (event) => jump(event.key === "f" ? 1 : -1, true)],
  [["+", "-"], "faster, slower", (event) => faster(event.key === "+" ? 1 : -1)],
  [["Home", "End"], "begin, end", (event) => seek(event.key === "Home" ? begin() : end())],
  [["0"], "the whole time line", whole],
  [["t"], "type a time: Enter goes there, Escape leaves it", () => { byId("time").focus(); byId("time").select(); }],
  [["m"], "measure: click two points of the 3-D view", press("measure")],
  [["l"], "copy a link to this moment", press("link")],
  [["d"], "light or dark", toggleTheme],
  [["?"], "this list", () => byId("keys").showModal()],
];
const MOUSE = [
  ["3-D: drag", "turn; right button or shift: move; wheel or two fingers: nearer"],
  ["plots: click, drag", "go to that time"],
  ["plots: wheel, two fingers", "zoom in time; on the axis of values, or with ctrl: in values"],
  ["plots: shift and drag", "move the range; on the axis of values: those"],
  ["plots: double click", "whole time line; on the axis of values: all values"],
  ["signal: drag, double click", "into a plot; a plot of its own"],
];
const WORDS = { " ": "space", ArrowLeft: "←", ArrowRight: "→" };

// Looks from one of the scene's places at the body, or at a gripper.
function look(name) {
  const side = page.moments[0], gripper = page.scenes[0].grippers.indexOf(name);
  page.rig.look(gripper < 0 ? side.body : side.grippers.slice(3 * gripper, 3 * gripper + 3), page.scenes[0].cameras[name]);
}

function addCameras() {
  const names = Object.keys(page.scenes[0].cameras);
  names.forEach((name, i) => {
    const button = element("button", "", name);
    button.title = `look: ${name} (${i + 1})`;
    button.onclick = () => look(name);
    byId("cameras").append(button);
  });
  KEYS.push([names.map((_, i) => String(i + 1)), `look: ${names.join(", ")}`, (event) => look(names[event.key - 1])]);
}

// The clipboard is for pages from this machine or by https; others select the text and copy that.
async function copyLink() {
  rememberNow();
  try {
    await navigator.clipboard.writeText(location.href);
  } catch {
    const field = byId("address").querySelector("input");
    field.value = location.href;
    byId("address").showModal();
    field.select();
    if (!document.execCommand("copy")) return; // stays open, to copy by hand
    byId("address").close();
  }
  tell("link copied");
}

function listen() {
  const clicks = { play, back: () => step(-1), forth: () => step(1), previous: () => jump(-1), next: () => jump(1),
    fault: () => jump(1, true), all: whole, link: copyLink, theme: toggleTheme, help: () => byId("keys").showModal() };
  for (const [id, act] of Object.entries(clicks)) byId(id).onclick = act;
  byId("time").onkeydown = (event) => { if (event.key === "Enter" || event.key === "Escape") leaveTime(event.key === "Enter"); };
  byId("time").onchange = () => leaveTime(true);
  byId("difference").onchange = draw;
  byId("filter").oninput = listSignals;
  byId("joints").ontoggle = showJoints;
  for (const box of byId("shown").querySelectorAll("input")) box.onchange = () => page.spaces.forEach((space) => space.soon());
  document.onkeydown = (event) => {
    if (document.querySelector("dialog[open]")) return;
    if (event.target.matches("input:not([type=checkbox]):not(dialog *)")) { // one in a closed dialog keeps the focus
      if (event.key === "Enter" || event.key === "Escape") event.target.blur();
      return;
    }
    const act = event.ctrlKey || event.metaKey || event.altKey ? null : KEYS.find(([keys]) => keys.includes(event.key));
    if (act) { event.preventDefault(); document.activeElement.blur(); act[2](event); }
  };
  window.onresize = () => { fetchSoon(); draw(); };
  window.onhashchange = recall;
  onTheme(() => { draw(); page.spaces.forEach((space) => space.theme()); });
  const line = (keys, words) => element("tr", "", "", element("th", "", "", ...keys), element("td", "", words));
  const table = byId("keys").querySelector("table");
  table.append(...KEYS.map(([keys, words]) => line(keys.map((key) => element("kbd", "", WORDS[key] || key)), words)));
  table.append(...MOUSE.map(([what, words]) => line([what], words)));
}

// Goes to the typed time where it is one, and gives the keys back to the page.
function leaveTime(goes) {
  const typed = Number(byId("time").value.replace(",", "."));
  byId("time").onchange = null;
  byId("time").blur();
  byId("time").onchange = () => leaveTime(true);
  if (goes && byId("time").value.trim() && Number.isFinite(typed)) seek(typed); else point();
}

function recall() {
  const said = new URLSearchParams(location.hash.slice(1));
  const number = (name, otherwise) => said.get(name) === null ? otherwise : Number(said.get(name)) || 0;
  view.from = number("from", isLive() ? end() - BEHIND_S : begin());
  view.to = number("to", isLive() ? end() + AHEAD_S : Math.max(end(), begin() + 1));
  const signals = Object.keys(page.story.signals), all = (word) => signals.filter((name) => name.startsWith(word)).join(",");
  takePlots(said.get("plots") || [all("margin_n."), all("body_error_mm") || all("surface_used.")].join(";"));
  view.time = number("t", begin());
}

function addSpaces() {
  page.rig = new Rig(page.scenes[0].up);
  const shows = (name) => byId(name).checked;
  page.scenes.forEach((scene, n) => {
    const box = element("div");
    byId("views").append(box);
    page.spaces.push(new Space(box, scene, page.rig, shows, page.story.sides[n].what));
    if (page.scenes.length > 1) box.append(element("b", "side", "AB"[n]));
  });
}

async function main() {
  putIcons();
  takeStory(await ask("/story"));
  const sides = page.story.sides;
  byId("names").textContent = document.title = sides.map((side) => side.name).join(" and ");
  byId("following").hidden = !isLive();
  byId("differing").hidden = sides.length < 2;
  if (sides[0].what === "plan") { // it has neither another plan nor faults
    byId("planned").checked = false;
    byId("planned").parentElement.hidden = byId("fault").hidden = true;
  }
  page.scenes = await ask("/scene");
  addSpaces();
  addCameras();
  showLegend();
  const empty = element("div", "empty", "drop a signal here for a new plot");
  byId("plots").append(empty);
  takeDrops(empty, (name) => addPlot([name]));
  listen();
  listenLayouts();
  listSignals();
  addCursors(byId("lanes"));
  pointAt(byId("lanes"));
  recall();
  listEvents();
  show(await ask(`/at?time_s=${view.time}&span_s=${view.to - view.from}`));
  if (page.spaces[0].renderer) look("overview");
  if (isLive()) live(); else seek(view.time);
  view.connected = true;
}

async function live() {
  setInterval(() => { if (follows()) showAt("newest"); }, NEWEST_EVERY_MS);
  setInterval(async () => {
    takeStory(await ask("/story"));
    listEvents();
    fetchSoon();
  }, STORY_EVERY_MS);
}

window.crux = { view, page, plots, byId, begin, end, seek, play, addPlot, look, setRange }; // for pictures and tests
main();
