// Puts the editor together: asks for the wall, then listens to keys, buttons, the mouse and the server.
import { byId, element, tell } from "../state.js";
import { COLOURS } from "../drawing.js";
import { putIcons } from "../icons.js";
import { Rig } from "../stage.js";
import { onTheme, toggleTheme } from "../theme.js";
import * as robot from "./ends.js";
import { listenFields } from "./fields.js";
import { found, listenFound, playOrPause } from "./found.js";
import { listenPointer } from "./pointer.js";
import { LIMBS, MARK, WallScene, colourOf } from "./scene.js";
import * as sketch from "./sketch.js";
import { ask, belong, send } from "./talk.js";

const STEP_M = 0.01, FINE_M = 0.001, TURN_DEG = 5, FINE_DEG = 1, SIZE_M = 0.005;
const UP = [1, 0, 0]; // of the wall
const ARROWS = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1] };
const CAMERAS = { wall: [-0.3, 0, 1.8], overview: [-1, -0.8, 1.4], side: [0, -1.8, 0.3] }, USUAL_M = 0.8, LEAST = 0.8; // of walls so long
const KEPT = { rig: null, scene: null, file: "" };

const grow = (axis, way) => () => sketch.shape(`size ${axis}`, (body) => { body.size_m[axis] = sketch.round(Math.max(body.size_m[axis] + way * SIZE_M, SIZE_M)); });
const turn = (way) => (event) => sketch.turnTo((sketch.chosen()?.yaw_deg ?? 0) + way * (event.shiftKey ? FINE_DEG : TURN_DEG));

function arrow(event) {
  const way = ARROWS[event.key], step = event.shiftKey ? FINE_M : STEP_M;
  if (robot.ends.choosing) robot.go(way); else sketch.move(way[0] * step, way[1] * step);
}

const KEYS = [ // keys, what they do in words, and what they do
  [["a"], "add a hold in the middle of the view, shaped as the chosen one", addInView],
  [["n", "p"], "choose the next, the previous hold", (event) => sketch.step(event.key === "n" ? 1 : -1)],
  [Object.keys(ARROWS), "move the hold by 10 mm, with shift 1 mm; or the robot to the next stance", arrow],
  [["q", "Q"], "turn it to the left by 5°, with shift 1°", turn(1)],
  [["e", "E"], "turn it to the right", turn(-1)],
  [["x", "y", "z"], "make it 5 mm larger along its x, y, z", (event) => grow("xyz".indexOf(event.key), 1)()],
  [["X", "Y", "Z"], "make it smaller", (event) => grow("XYZ".indexOf(event.key), -1)()],
  [["o"], "make it an obstacle, or a hold again", sketch.toggleObstacle],
  [["Delete", "Backspace"], "delete it", sketch.remove],
  [["s", "g"], "choose the start, the goal among the stances", (event) => robot.begin(event.key === "s" ? "start" : "goal")],
  [["Enter"], "take the stance that is shown", () => { if (robot.ends.choosing) robot.take(); }],
  [["Escape"], "leave it; choose no hold", () => { if (robot.ends.choosing) robot.leave(); else sketch.choose(null); }],
  [[" "], "play or pause the plan", playOrPause],
  [["w", "v", "b"], `look: ${Object.keys(CAMERAS).join(", ")}`, (event) => look(Object.keys(CAMERAS)["wvb".indexOf(event.key)])],
  [["d"], "light or dark", toggleTheme],
  [["?"], "this list", () => byId("keys").showModal()],
];
const WITH_CTRL = [
  [["s"], "save", save],
  [["z"], "undo; with shift redo", (event) => event.shiftKey ? sketch.redo() : sketch.undo()],
  [["y"], "redo", sketch.redo],
];
const MOUSE = [
  ["hold: click, drag", "choose it, move it in steps of 5 mm (shift: freely)"],
  ["blue ball, red balls: drag", "turn the chosen hold; make it larger or smaller"],
  ["wall: double click", "add a hold there"],
  ["robot: drag", "the start or, transparent, the goal to another stance"],
  ["elsewhere: drag", "turn the view; right button: move; wheel: nearer"],
];
const WORDS = { " ": "space", ArrowUp: "↑", ArrowDown: "↓", ArrowLeft: "←", ArrowRight: "→" };

function addInView() {
  const { x, y } = KEPT.scene?.controls?.target ?? { x: 0, y: 0 };
  sketch.add([x, y]);
}

function look(name) {
  const places = sketch.bodies().map((body) => body.position_m);
  const spans = [0, 1].map((k) => places.length ? [Math.min(...places.map((p) => p[k])), Math.max(...places.map((p) => p[k]))] : [-USUAL_M / 2, USUAL_M / 2]);
  const far = Math.max(LEAST, ...spans.map(([low, high]) => (high - low) / USUAL_M));
  KEPT.rig.look([...spans.map(([low, high]) => (low + high) / 2), 0], CAMERAS[name].map((x) => x * far));
}

// Asks before anything on the disk would be lost.
async function save() {
  try {
    const sent = structuredClone(sketch.wall.sketch);
    let answer = await send("/save", { sketch: sent, over: false });
    if (answer.question) {
      if (!await confirmed(answer.question)) return;
      answer = await send("/save", { sketch: sent, over: true });
    }
    if (answer.error) { tell(answer.error); return; }
    sketch.wall.saved = JSON.stringify(sent);
    const still = found.missing.length ? `; crux plan needs ${found.missing.join(" and ")} as well` : "";
    tell(`${KEPT.file} is saved${still}`);
    showState();
  } catch (error) {
    tell(error.message);
  }
}

function confirmed(question) {
  const dialog = byId("question");
  dialog.querySelector("p").textContent = question;
  dialog.returnValue = "";
  dialog.showModal();
  return new Promise((resolve) => { dialog.onclose = () => resolve(dialog.returnValue === "yes"); });
}

function showState() {
  byId("names").classList.toggle("unsaved", !sketch.isSaved());
  byId("names").title = sketch.isSaved() ? "" : "not saved";
  const { undo, redo } = sketch.can();
  [byId("undo").disabled, byId("redo").disabled, byId("remove").disabled] = [!undo, !redo, sketch.wall.chosen === null];
}

function onKey(event) {
  if (document.querySelector("dialog[open]")) return;
  const withCtrl = event.ctrlKey || event.metaKey;
  if (!withCtrl && event.target.matches("input:not([type=checkbox]):not([type=range])")) {
    if (event.key === "Enter" || event.key === "Escape") event.target.blur();
    return;
  }
  const [, , act] = event.altKey ? [] : (withCtrl ? WITH_CTRL : KEYS).find(([keys]) => keys.includes(withCtrl ? event.key.toLowerCase() : event.key)) ?? [];
  if (!act || (event.target.matches("button") && ["Enter", " "].includes(event.key))) return;
  event.preventDefault();
  if (withCtrl) document.activeElement.blur(); // what is typed counts
  act(event);
}

function listen() {
  const clicks = { save, undo: sketch.undo, redo: sketch.redo, add: addInView, remove: sketch.remove, theme: toggleTheme,
    "set-start": () => robot.begin("start"), "set-goal": () => robot.begin("goal"), help: () => byId("keys").showModal() };
  for (const [id, act] of Object.entries(clicks)) byId(id).onclick = () => { act(); byId(id).blur(); };
  document.onkeydown = onKey;
  window.onbeforeunload = (event) => { if (!sketch.isSaved()) event.preventDefault(); };
  onTheme(() => KEPT.scene.renderer && KEPT.scene.theme());
  const line = (keys, words) => element("tr", "", "", element("th", "", "", ...keys), element("td", "", words));
  const shown = (keys, before) => keys.map((key) => element("kbd", "", before + (WORDS[key] || key)));
  byId("keys").querySelector("table").append(...KEYS.map(([keys, words]) => line(shown(keys, ""), words)),
    ...WITH_CTRL.map(([keys, words]) => line(shown(keys, "ctrl "), words)), ...MOUSE.map(([what, words]) => line([what], words)));
}

function addCameras() {
  for (const name of Object.keys(CAMERAS)) {
    const button = element("button", "", name);
    button.onclick = () => look(name);
    byId("cameras").append(button);
  }
}

function showLegend() {
  const spot = (colour, words, name = "") => {
    const line = element("span", "", words);
    line.prepend(element("i", name));
    line.firstChild.style.background = colour;
    return line;
  };
  const css = (shares) => `rgb(${colourOf(shares, false).map(Math.round).join(" ")})`;
  byId("legend").replaceChildren(
    spot(css([0, 0, 0, 0]), "no limb can grip it", "square"), spot(css([1, 0, 0, 0]), "one limb", "square"), spot(css([1, 1, 1, 1]), "all limbs", "square"),
    element("span", "", "larger dots: from more places of the body"), ...LIMBS.map((limb, k) => spot(COLOURS[k], limb)),
    spot(`#${MARK.toString(16)}`, "pads of its grips"));
}

async function main() {
  putIcons();
  const told = await ask("/wall");
  KEPT.file = byId("names").textContent = document.title = told.name;
  belong(told.session);
  sketch.open(told.sketch, told.isNew);
  KEPT.rig = new Rig(UP);
  KEPT.scene = robot.ends.scene = new WallScene(document.querySelector("#views > div"), KEPT.rig, told.shapes);
  addCameras();
  showLegend();
  listen();
  sketch.onChange(showState);
  listenFields();
  listenFound();
  if (KEPT.scene.renderer) { listenPointer(KEPT.scene); look("wall"); }
  showState();
  window.crux = { sketch, robot, found, scene: KEPT.scene, look, byId, ready: true }; // for pictures and tests
}

main().catch((error) => tell(error.message));
