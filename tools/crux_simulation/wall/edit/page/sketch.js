// The wall as it is edited, with what was before: every change goes through `change`, so that it can be undone.
const SAME_MS = 900, DIGITS = 4, MOST_KEPT = 500;
const NEW_SIZE_M = [0.06, 0.06, 0.06], NEW_FRICTION = 2.2;

export const wall = { sketch: null, chosen: null, saved: "", version: 0 };
const past = [], future = [], listeners = [];
let last = { tag: "", at: 0 };

export const round = (x) => Number(x.toFixed(DIGITS));
export const onChange = (act) => listeners.push(act);
export const bodies = () => wall.sketch.bodies;
export const chosen = () => bodies().find((body) => body.id === wall.chosen) ?? null;
export const named = (name) => bodies().find((body) => body.name === name) ?? null;
export const isSaved = () => JSON.stringify(wall.sketch) === wall.saved;
export const can = () => ({ undo: past.length > 0, redo: future.length > 0 });

export function open(sketch, isNew) {
  wall.sketch = sketch;
  wall.saved = isNew ? "" : JSON.stringify(sketch);
}

export function choose(id) {
  wall.chosen = id;
  tellAll(false);
}

function tellAll(changed) {
  if (changed) wall.version += 1;
  if (wall.chosen !== null && !chosen()) wall.chosen = null;
  listeners.forEach((act) => act(changed));
}

// Changes that follow each other with the same tag are undone together.
export function change(tag, act) {
  const before = JSON.stringify(wall.sketch);
  act(wall.sketch);
  if (JSON.stringify(wall.sketch) === before) return;
  const now = performance.now();
  if (!tag || tag !== last.tag || now - last.at > SAME_MS) past.push({ sketch: before, chosen: wall.chosen });
  if (past.length > MOST_KEPT) past.shift();
  future.length = 0;
  last = { tag, at: now };
  tellAll(true);
}

function travel(from, to) {
  if (!from.length) return;
  to.push({ sketch: JSON.stringify(wall.sketch), chosen: wall.chosen });
  const then = from.pop();
  wall.sketch = JSON.parse(then.sketch);
  wall.chosen = then.chosen;
  last = { tag: "", at: 0 };
  tellAll(true);
}

export const undo = () => travel(past, future);
export const redo = () => travel(future, past);
export const settle = () => { last = { tag: "", at: 0 }; }; // what follows is undone by itself

function freshName() {
  let number = 1;
  while (named(`h${number}`)) number += 1;
  return `h${number}`;
}

export function add(position) {
  const like = chosen(), id = Math.max(-1, ...bodies().map((body) => body.id), wall.newest ?? -1) + 1;
  wall.newest = id;
  change("", (sketch) => {
    sketch.bodies.push({
      id, obstacle: false, name: freshName(), position_m: position.map(round), yaw_deg: like?.yaw_deg ?? 0, lean_deg: {},
      size_m: [...(like?.size_m ?? NEW_SIZE_M)], friction: like?.obstacle === false ? structuredClone(like.friction) : NEW_FRICTION,
    });
    wall.chosen = id;
  });
}

export function remove() {
  const order = bodies(), at = order.findIndex((body) => body.id === wall.chosen);
  if (at < 0) return;
  change("", (sketch) => { sketch.bodies.splice(at, 1); });
  choose(bodies()[Math.min(at, bodies().length - 1)]?.id ?? null);
}

// Changes the chosen body by a function of it.
export function shape(tag, act) {
  const id = wall.chosen;
  if (chosen()) change(`${tag} ${id}`, () => act(chosen()));
}

export const moveTo = (position) => shape("move", (body) => { body.position_m = position.map(round); });
export const move = (dx, dy) => shape("move", (body) => { body.position_m = [round(body.position_m[0] + dx), round(body.position_m[1] + dy)]; });
export const turnTo = (degrees) => shape("turn", (body) => { body.yaw_deg = round(degrees - 360 * Math.round(degrees / 360)); });
export const resizeTo = (axis, length) => shape(`size ${axis}`, (body) => { body.size_m[axis] = round(Math.max(length, 0.005)); });

export function toggleObstacle() {
  shape("kind", (body) => {
    body.obstacle = !body.obstacle;
    if (!body.obstacle && body.friction == null) body.friction = NEW_FRICTION;
  });
}

// The grasps of start and goal follow the name.
export function rename(name) {
  const old = chosen()?.name;
  if (!old || !name.trim()) return;
  change("", (sketch) => {
    chosen().name = name.trim();
    for (const end of [sketch.start, sketch.goal])
      for (const grasp of Object.values(end?.grasps ?? {})) if (grasp.hold === old) grasp.hold = name.trim();
  });
}

// A stance becomes the start, or the goal with or without its grasps; what the file says besides stays.
export function setEnd(end, stance, withGrasps) {
  change("", (sketch) => {
    const old = sketch[end] ?? {}, grasps = structuredClone(stance.grasps);
    const made = { ...old, body: { ...old.body, position_m: [...stance.position_m] } };
    const heading = sketch.start?.body.rpy_deg?.[2] ?? 0; // stances are level, and headed as the start is
    if (heading || made.body.rpy_deg) made.body.rpy_deg = [0, 0, heading];
    delete made.air;
    delete made.grasps;
    sketch[end] = withGrasps ? { ...made, grasps } : made;
  });
}

export function step(way) {
  const order = bodies(), at = order.findIndex((body) => body.id === wall.chosen);
  if (order.length) choose(order[(at + way + order.length + (at < 0 && way < 0 ? 1 : 0)) % order.length].id);
}
