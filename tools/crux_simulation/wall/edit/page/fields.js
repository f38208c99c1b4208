// The column beside the view: numbers of the wall and of the chosen body.
import { byId, element } from "../state.js";
import { change, chosen, onChange, rename, settle, shape, toggleObstacle, turnTo, wall } from "./sketch.js";

const MM = 1000;
const written = (value, factor) => String(Number((value * factor).toFixed(3)));

// A number that is taken when the field is left or by Enter; what is no number stays as it was.
function number(name, value, take, factor = 1) {
  const field = element("input");
  [field.value, field.inputMode, field.ariaLabel] = [written(value, factor), "decimal", name];
  field.onchange = () => {
    const typed = Number(field.value.replace(",", "."));
    settle(); // undone by itself
    if (field.value.trim() && Number.isFinite(typed)) take(typed / factor); else field.value = written(value, factor);
  };
  return field;
}

const row = (words, ...fields) => element("label", "", "", element("span", "", words), ...fields);
const several = (words, ...fields) => element("label", "", "", element("span", "", words), element("div", "three", "", ...fields));

function wallFields() {
  const { sketch } = wall, set = (key) => (value) => change(key, (all) => { all[key] = value; });
  return [
    row("slope [°]", number("slope", sketch.slope_deg, set("slope_deg"))),
    row("friction for feet", number("friction of the wall", sketch.friction, set("friction"))),
    row("steps at most", number("steps", sketch.steps, (value) => set("steps")(Math.round(value)))),
  ];
}

function frictionField(body) {
  if (typeof body.friction === "number") return row("friction", number("friction", body.friction, (value) => shape("friction", (now) => { now.friction = value; })));
  const faces = Object.entries(body.friction ?? {});
  return several("friction by face", ...faces.map(([face, value]) => number(`friction of ${face}`, value, (typed) => shape(`friction ${face}`, (now) => { now.friction[face] = typed; }))));
}

function bodyFields(body) {
  const name = element("input"), kind = element("input"), at = (k) => (value) => shape(`move ${k}`, (now) => { now.position_m[k] = value; });
  [name.value, name.ariaLabel, kind.type, kind.checked, kind.ariaLabel] = [body.name, "name", "checkbox", body.obstacle, "obstacle"];
  name.onchange = () => rename(name.value);
  kind.onchange = toggleObstacle;
  const size = (k) => (value) => shape(`size ${k}`, (now) => { now.size_m[k] = value; });
  return [
    row("name", name),
    several("x up, y left [mm]", ...[0, 1].map((k) => number("xy"[k], body.position_m[k], at(k), MM))),
    several("size x, y, z [mm]", ...[0, 1, 2].map((k) => number(`size ${"xyz"[k]}`, body.size_m[k], size(k), MM))),
    row("turned by [°]", number("yaw", body.yaw_deg, turnTo)),
    ...(body.obstacle ? [] : [frictionField(body)]),
    row("obstacle", kind),
  ];
}

function show() {
  const body = chosen(), focus = document.activeElement?.ariaLabel, of = document.activeElement?.closest(".fields")?.id;
  byId("wall").replaceChildren(...wallFields());
  byId("body-title").textContent = body ? (body.obstacle ? "Obstacle" : "Hold") : "No hold is chosen";
  byId("body").replaceChildren(...(body ? bodyFields(body) : []));
  if (of) [...byId(of).querySelectorAll("input")].find((field) => field.ariaLabel === focus)?.focus();
}

export function listenFields() {
  onChange(show);
  show();
}
