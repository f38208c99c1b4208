// Start and goal: the robot drawn there, and the ghost that snaps to stances while one of them is chosen.
import { byId, tell } from "../state.js";
import { send } from "./talk.js";
import { setEnd, settle, wall } from "./sketch.js";

const AHEAD = 0.6; // cosine of how far a stance may lie beside the way that an arrow key points
const { hypot } = Math;

export const ends = { scene: null, stances: [], choosing: null, at: null, playing: false };
const shown = { start: "", goal: "" }, asked = { start: null, goal: null };

const standing = (end) => {
  const own = wall.sketch[end];
  if (!own?.body) return null;
  return { body: own.body, grasps: { ...stanceAt(own.body.position_m)?.grasps, ...own.grasps } }; // a goal may leave them open
};

const stanceAt = (place) => ends.stances.find((stance) => hypot(...stance.position_m.map((x, k) => x - place[k])) < 1e-3);

// Draws the robot where start and goal are, or where the one that is being chosen would be.
export function showEnds() {
  for (const end of ["start", "goal"]) {
    if (end === "start" && ends.playing) continue;
    const chosen = ends.choosing === end && ends.at;
    show(end, chosen ? { body: { ...wall.sketch[end]?.body, position_m: ends.at.position_m }, grasps: ends.at.grasps } : standing(end));
  }
}

export const redrawStart = () => { shown.start = ""; showEnds(); };

// One question at a time for each; the newest wish is kept.
async function show(end, stance) {
  const key = JSON.stringify([stance, wall.sketch.bodies]);
  if (shown[end] === key) return;
  shown[end] = key;
  if (!stance) { ends.scene.pose(end, null); return; }
  if (asked[end]) { asked[end] = { stance, key }; return; }
  asked[end] = { stance, key };
  try {
    while (asked[end]) {
      const wish = asked[end];
      const drawn = await send("/pose", { sketch: wall.sketch, ...wish.stance });
      if (shown[end] === wish.key && !(end === "start" && ends.playing)) ends.scene.pose(end, drawn.poses);
      asked[end] = asked[end] === wish ? null : asked[end];
    }
  } catch (error) {
    asked[end] = null;
    tell(error.message);
  }
}

export function takeStances(stances) {
  ends.stances = stances;
  if (ends.choosing && !stances.length) leave();
  refresh();
}

function refresh() {
  ends.scene.showPlaces(ends.choosing ? ends.stances : []);
  byId("hint").hidden = !ends.choosing;
  for (const end of ["start", "goal"]) byId(`set-${end}`).classList.toggle("on", ends.choosing === end);
  if (ends.choosing) {
    const at = ends.at.position_m.map((x) => x.toFixed(2)), holds = Object.entries(ends.at.grasps).map(([limb, grasp]) => `${limb} ${grasp.hold} ${grasp.faces}`);
    byId("hint").textContent = `${ends.choosing}: body at ${at[0]}, ${at[1]} m, ${holds.join(", ")}. Drag or arrow keys: other stances; Enter: take it; Escape: leave it.`;
  }
  showEnds();
}

export function begin(end) {
  if (ends.choosing === end) { leave(); return; }
  if (!ends.stances.length) {
    tell("The map has no stance on this wall: no place from which the four limbs grip a hold each. Add or move holds; white ones are still being looked at.");
    return;
  }
  ends.choosing = end;
  const own = wall.sketch[end] ?? wall.sketch.start;
  ends.at = nearest(own?.body?.position_m ?? [-9, 0]);
  refresh();
}

export const nearest = (place) => ends.stances.toSorted((a, b) => distance(a, place) - distance(b, place))[0];
const distance = (stance, [x, y]) => hypot(stance.position_m[0] - x, stance.position_m[1] - y);

// The ghost to the stance nearest to a place of the wall.
export function snap(place) {
  ends.at = nearest(place);
  refresh();
}

// The ghost to the next stance in a direction.
export function go([dx, dy]) {
  const [x, y] = ends.at.position_m;
  const ahead = ends.stances.filter((stance) => {
    const [a, b] = [stance.position_m[0] - x, stance.position_m[1] - y], far = hypot(a, b);
    return far > 1e-6 && (a * dx + b * dy) / far > AHEAD;
  });
  if (ahead.length) { ends.at = ahead.sort((a, b) => distance(a, [x, y]) - distance(b, [x, y]))[0]; refresh(); }
}

export function take() {
  const { choosing, at } = ends;
  leave();
  settle();
  setEnd(choosing, at, choosing === "start" || byId("with-grasps").checked);
}

export function leave() {
  [ends.choosing, ends.at] = [null, null];
  refresh();
}
