// Puts the page together: sliders of joints, fingers and the wall's slope, and what the server finds out of them.
import { ask, byId, element, tell } from "../state.js";
import { COLOURS } from "../drawing.js";
import { putIcons } from "../icons.js";
import { Rig } from "../stage.js";
import { onTheme, toggleTheme } from "../theme.js";
import { RobotScene } from "./scene.js";

const UP = [0, 0, 1], MUCH = 0.75, MM = 1000;
const CAMERAS = { overview: [-1.2, -0.75, 0.7], front: [-1.6, 0, 0.05], side: [0, -1.6, 0.1], top: [-0.05, 0, 1.7], below: [-0.9, -0.6, -1] };
const posture = { q: [], openingM: 0, slopeDeg: 0, lifted: null };
const state = { told: null, scene: null, rig: null, found: null, asking: false, wanted: false };
const rows = []; // by limb: {joint, slider, value, used, limb, index}
const fixed = (x, digits) => x.toFixed(digits).replace("-", "−");

const KEYS = [
  [["s"], "every gripper in the middle of what its limb reaches", () => go((joint) => joint.start)],
  [["m"], "every joint in the middle of its limits", () => go((joint) => (joint.low + joint.high) / 2)],
  [["r", "f", "w"], "show or hide reach, frames, wall", (event) => byId({ r: "reach", f: "frames", w: "wall" }[event.key]).click()],
  [["d"], "light or dark", toggleTheme],
  [["?"], "this list", () => byId("keys").showModal()],
];
const MOUSE = [
  ["slider: arrows", "a step; Home and End: the joint's limits"],
  ["3-D: drag", "turn the view; right button: move; wheel: nearer"],
];

// One request at a time; what has changed meanwhile is asked for next.
async function update() {
  state.wanted = true;
  if (state.asking) return;
  state.asking = true;
  while (state.wanted) {
    state.wanted = false;
    try {
      const answer = await fetch("./posture", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(posture) });
      if (!answer.ok) throw new Error(await answer.text());
      state.found = await answer.json();
      state.scene.show(state.found, posture.slopeDeg);
      showFound();
    } catch (error) {
      tell(error instanceof TypeError ? "The page's server has ended: start crux robot show again." : error.message);
    }
  }
  state.asking = false;
}

function showFound() {
  const { grippers, meets, loads } = state.found, verdict = byId("verdict");
  verdict.classList.toggle("bad", Boolean(loads.why) || loads.share > 1);
  verdict.textContent = loads.why ?? `Hanging takes at least ${Math.round(100 * loads.share)} % of the peak torque of ${loads.joint}`
    + (loads.share > 1 ? ": more than it has" : "");
  byId("meets").replaceChildren(...meets.map(({ links, gapM }) => element("li", "", gapM < 0
    ? `${links.join(" and ")} overlap` : `${links.join(" and ")}: ${fixed(MM * gapM, 1)} mm apart`)));
  grippers.forEach(({ positionM, tiltDeg, yawDeg }, k) => {
    byId(`gripper-${k}`).textContent = `${positionM.map((x) => fixed(MM * x, 0)).join(", ")} mm, yaw ${fixed(yawDeg, 0)}°, ${fixed(tiltDeg, 0)}° off upright`;
  });
  for (const { used, limb, index } of rows) {
    const share = loads.shares?.[limb][index];
    used.className = `used${share > 1 ? " over" : share > MUCH ? " much" : ""}`;
    used.firstChild.style.width = `${100 * Math.min(share ?? 0, 1)}%`;
    used.lastChild.textContent = share === undefined ? "" : `${Math.round(100 * share)} %`;
  }
}

// A slider in a grid of four columns: name, slider, value, and `last`.
function slider(name, [low, high], start, words, take, last = element("span")) {
  const input = Object.assign(element("input"), { type: "range", min: low, max: high, step: "any", value: start });
  input.setAttribute("aria-label", name);
  const value = element("output");
  const show = () => { value.textContent = words(Number(input.value)); };
  input.oninput = () => { show(); take(Number(input.value)); update(); };
  show();
  return { input, show, parts: element("label", "", "", element("span", "", name), input, value, last) };
}

function addJoints() {
  state.told.limbs.forEach((limb, k) => {
    const spot = element("i"), title = element("h2", "", "", spot, limb.name, Object.assign(element("small"), { id: `gripper-${k}` }));
    spot.style.background = COLOURS[k];
    const grid = element("div", "joints");
    limb.joints.forEach((joint, index) => {
      const used = element("div", "used", "", element("i"), element("b"));
      used.title = "share of the peak torque";
      const made = slider(joint.name, [joint.low, joint.high], joint.start, (q) => `${fixed(q, 2)} rad`, (q) => { posture.q[k][index] = q; }, used);
      made.parts.title = `${fixed(joint.low, 2)} to ${fixed(joint.high, 2)} rad`;
      made.parts.onpointerenter = () => state.scene.mark(joint.body);
      made.parts.onpointerleave = () => state.scene.mark(null);
      rows.push({ joint, used, limb: k, index, ...made });
      grid.append(made.parts);
    });
    byId("limbs").append(title, grid);
  });
}

function addWall() {
  const [low, high, open] = state.told.openingM;
  const slope = slider("slope", [0, 180], posture.slopeDeg, (x) => `${fixed(x, 0)}°`, (x) => { posture.slopeDeg = x; });
  slope.input.step = 1;
  slope.input.value = posture.slopeDeg;
  slope.show();
  const fingers = slider("fingers", [low, high], open, (x) => `${fixed(MM * x, 0)} mm`, (x) => { posture.openingM = x; });
  byId("wall-fields").append(slope.parts, fingers.parts);
  byId("lifted").append(new Option("on all limbs", ""), ...state.told.limbs.map((limb, k) => new Option(`with ${limb.name} in the air`, k)));
  byId("lifted").onchange = () => {
    posture.lifted = byId("lifted").value === "" ? null : Number(byId("lifted").value);
    update();
  };
}

// All joints to an angle of each.
function go(angle) {
  for (const { joint, input, show, limb, index } of rows) {
    input.value = posture.q[limb][index] = angle(joint);
    show();
  }
  update();
}

async function addReach() {
  if (!state.told.planned) {
    byId("reach").closest("label").hidden = true; // the planner has no map of it
    return;
  }
  for (const k of state.told.limbs.keys()) state.scene.setReach(k, await ask(`/reach?limb=${k}`));
}

function look(name) { state.rig.look([0, 0, -state.told.heightM / 2], CAMERAS[name]); }

function listen() {
  for (const [id, key] of Object.entries({ stance: "s", middle: "m", theme: "d", help: "?" }))
    byId(id).onclick = () => KEYS.find(([keys]) => keys.includes(key))[2]();
  for (const box of byId("shown").querySelectorAll("input")) box.onchange = () => state.scene.soon();
  document.onkeydown = (event) => {
    if (document.querySelector("dialog[open]") || event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select")) return;
    const act = KEYS.find(([keys]) => keys.includes(event.key));
    if (act) { event.preventDefault(); act[2](event); }
  };
  onTheme(() => state.scene.renderer && state.scene.theme());
  const line = (keys, words) => element("tr", "", "", element("th", "", "", ...keys), element("td", "", words));
  byId("keys").querySelector("table").append(...KEYS.map(([keys, words]) => line(keys.map((key) => element("kbd", "", key)), words)),
    ...MOUSE.map(([what, words]) => line([what], words)));
  for (const name of Object.keys(CAMERAS)) {
    const button = element("button", "", name);
    button.onclick = () => look(name);
    byId("cameras").append(button);
  }
}

function addLegend() {
  byId("legend").replaceChildren(...state.told.limbs.map((limb, k) => {
    const line = element("span", "", "", element("i"), `${limb.name}: reach`);
    line.firstChild.style.background = COLOURS[k];
    return line;
  }));
}

async function main() {
  putIcons();
  const told = state.told = await ask("/robot");
  byId("names").textContent = document.title = told.name;
  Object.assign(posture, { q: told.limbs.map((limb) => limb.joints.map((joint) => joint.start)), openingM: told.openingM[2], slopeDeg: told.slopeDeg });
  state.rig = new Rig(UP);
  state.scene = new RobotScene(document.querySelector("#views > div"), state.rig, told);
  byId("shapes").closest("label").hidden = !told.shapes.some((shape) => shape.kind === "mesh");
  addWall();
  addJoints();
  addLegend();
  listen();
  if (state.scene.renderer) look("overview");
  await update();
  if (state.scene.renderer) await addReach();
  window.crux = { posture, scene: state.scene, told, look, byId, found: () => state.found, idle: () => !state.asking && !state.wanted, ready: true }; // for pictures and tests
}

main().catch((error) => tell(error.message));
