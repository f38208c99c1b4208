// The wall in 3-D: bodies with the limbs that grip them, the robot at start and goal, and the way of a plan.
import * as THREE from "three";
import { CSS2DObject } from "../three/CSS2DRenderer.js";
import { bodiesOf, ghostsOf, put } from "../bodies.js";
import { COLOURS } from "../drawing.js";
import { element } from "../state.js";
import { rgb, wall as slab } from "../shapes.js";
import { Stage } from "../stage.js";
import { wall } from "./sketch.js";

const AROUND_M = 1.0, LEAST_M = 1.5, GOAL_OPACITY = 0.45, DOT_M = 0.012, USUAL_SHARE = 0.1, LEAST = 0.4, MOST = 1.4, RIM = 1.25, KNOB_M = 0.013, KNOB_OFF_M = 0.05, MARK_M = 0.006;
const NONE = [212, 36, 36], ONE = [237, 186, 38], ALL = [46, 161, 89], UNKNOWN = [150, 148, 142], OBSTACLE = [92, 92, 100];
const CHOSEN = 0x1f6fd0, KNOB = 0xe0218a, WAY = 0x9a4fd0, PLACE = 0x1f9f9f;
export const MARK = 0x5b2a86;
const QUARTERS = [[1, 1], [1, -1], [-1, 1], [-1, -1]]; // of a body's top, of LF, RF, LR, RR
export const LIMBS = ["LF", "RF", "LR", "RR"];

// By limb, from what share of the bodies around it a hold can be gripped at best; null: not known.
export function sharesOf(reach, body) {
  const pairs = body.obstacle ? null : reach?.holds[body.name];
  return pairs ? LIMBS.map((limb) => Math.max(0, ...pairs.map((pair) => pair.limbs[limb] ?? 0))) : null;
}

// Where the pads of its grips touch, along its own axes.
function marksOf(reach, body) {
  return body.obstacle ? [] : (reach?.holds[body.name] ?? []).flatMap((pair) => pair.marks);
}

export function colourOf(shares, obstacle) {
  if (obstacle) return OBSTACLE;
  if (!shares) return UNKNOWN;
  const count = shares.filter(Boolean).length;
  return count ? ONE.map((from, k) => from + (ALL[k] - from) * (count - 1) / 3) : NONE;
}

// A box that stands on z = 0, of its real size; sides may lean in.
function form(body) {
  const made = new THREE.BoxGeometry(...body.size_m).translate(0, 0, body.size_m[2] / 2), place = made.attributes.position;
  const lean = (face) => body.size_m[2] * Math.tan((body.lean_deg[face] ?? 0) * Math.PI / 180);
  for (let i = 0; i < place.count; i++) {
    if (place.getZ(i) <= 0) continue;
    place.setX(i, place.getX(i) + (place.getX(i) > 0 ? -lean("+x") : lean("-x")));
    place.setY(i, place.getY(i) + (place.getY(i) > 0 ? -lean("+y") : lean("-y")));
  }
  made.computeVertexNormals();
  return made;
}

function label(words, name) {
  const made = new CSS2DObject(element("div", name, words));
  made.center.set(0.5, 1.2);
  return made;
}

export class WallScene extends Stage {
  constructor(box, rig, shapes) {
    super(box, rig, "Walls are drawn in 3-D: try another browser.");
    if (!this.renderer) return;
    [this.made, this.extent] = [new Map(), null];
    this.robot = bodiesOf(shapes);
    this.goal = ghostsOf(shapes);
    for (const ghost of this.goal) ghost.paint.opacity = GOAL_OPACITY;
    this.figures = { start: this.robot, goal: this.goal.map((ghost) => ghost.group) };
    for (const group of [...this.robot, ...this.figures.goal]) group.visible = false;
    this.knobs = new THREE.Group();
    this.places = new THREE.Points(new THREE.BufferGeometry(), new THREE.PointsMaterial({ color: PLACE, size: 7, sizeAttenuation: false }));
    this.way = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: WAY }));
    this.places.frustumCulled = this.way.frustumCulled = false;
    this.scene.add(...this.robot, ...this.figures.goal, this.knobs, this.places, this.way);
    this.ray = new THREE.Raycaster();
    this.lightUp(new THREE.Vector3());
  }

  // `reach`, `blamed`: what is known of the holds, and the words at those that a refusal names.
  set(reach, blamed) {
    if (!this.renderer) return;
    this.#wall();
    const there = new Set(wall.sketch.bodies.map((body) => body.id));
    for (const [id, group] of this.made) if (!there.has(id)) { this.#drop(group); this.made.delete(id); }
    for (const body of wall.sketch.bodies) this.#body(body, sharesOf(reach, body), marksOf(reach, body), blamed);
    this.#knobs();
    this.soon();
  }

  #wall() {
    const places = [...wall.sketch.bodies.map((body) => body.position_m), [0, 0]];
    const low = [0, 1].map((k) => Math.min(-LEAST_M / 2, ...places.map((p) => p[k] - AROUND_M)));
    const high = [0, 1].map((k) => Math.max(LEAST_M, ...places.map((p) => p[k] + AROUND_M)));
    low[1] = Math.min(low[1], -LEAST_M);
    if (this.extent && [0, 1].every((k) => this.extent.low[k] <= low[k] && this.extent.high[k] >= high[k])) return;
    if (this.slab) { this.scene.remove(this.slab); this.slab.geometry.dispose(); }
    const size = [0, 1].map((k) => high[k] - low[k]), middle = [0, 1].map((k) => (high[k] + low[k]) / 2);
    this.slab = slab({ size, position: [...middle, 0], wxyz: [1, 0, 0, 0] }, this.slow);
    this.extent = { low, high };
    this.scene.add(this.slab);
  }

  #drop(group) {
    group.traverse((each) => { each.element?.remove(); each.geometry?.dispose(); });
    this.scene.remove(group);
  }

  #body(body, shares, marks, blamed) {
    const chosen = body.id === wall.chosen, key = JSON.stringify([body, shares, marks, chosen, blamed[body.name] ?? ""]);
    const old = this.made.get(body.id);
    if (old?.key === key) return;
    if (old) this.#drop(old);
    const group = new THREE.Group(), shown = form(body);
    const mesh = new THREE.Mesh(shown, new THREE.MeshLambertMaterial({ color: rgb(colourOf(shares, body.obstacle)) }));
    mesh.castShadow = mesh.receiveShadow = true;
    mesh.userData.id = body.id;
    group.add(mesh);
    if (chosen) group.add(new THREE.LineSegments(new THREE.EdgesGeometry(shown), new THREE.LineBasicMaterial({ color: CHOSEN, linewidth: 3 })));
    (shares ?? []).forEach((share, limb) => {
      if (!share) return;
      const dot = new THREE.Mesh(new THREE.SphereGeometry(DOT_M * Math.min(Math.max(Math.sqrt(share / USUAL_SHARE), LEAST), MOST), 12, 8), new THREE.MeshBasicMaterial({ color: COLOURS[limb] }));
      dot.position.set(...QUARTERS[limb].map((side, k) => side * body.size_m[k] / 4), body.size_m[2]);
      const rim = new THREE.Mesh(dot.geometry, new THREE.MeshBasicMaterial({ color: 0xffffff, side: THREE.BackSide }));
      rim.scale.setScalar(RIM);
      dot.add(rim);
      group.add(dot);
    });
    for (const place of marks) {
      const mark = new THREE.Mesh(new THREE.SphereGeometry(MARK_M, 12, 8), new THREE.MeshBasicMaterial({ color: MARK }));
      mark.position.set(...place);
      mark.userData.mark = true;
      group.add(mark);
    }
    const name = label(body.name, chosen ? "hold chosen" : "hold");
    name.position.set(body.size_m[0] / 2, 0, body.size_m[2]);
    group.add(name);
    if (blamed[body.name]) {
      const why = label(blamed[body.name], "why");
      why.center.set(0.5, -0.2);
      why.position.set(-body.size_m[0] / 2, 0, 0); // at the foot: a body may be higher than the eye
      group.add(why);
    }
    group.position.set(...body.position_m, 0);
    group.rotation.z = body.yaw_deg * Math.PI / 180;
    group.key = key;
    this.made.set(body.id, group);
    this.scene.add(group);
  }

  // To turn and to resize the chosen body.
  #knobs() {
    for (const knob of [...this.knobs.children]) { knob.geometry.dispose(); this.knobs.remove(knob); }
    const body = wall.sketch.bodies.find((each) => each.id === wall.chosen);
    if (!body) return;
    const [x, y, z] = body.size_m;
    for (const [what, place] of [["turn", [x / 2 + KNOB_OFF_M, 0, z / 2]], ["x", [-x / 2, 0, z / 2]], ["y", [0, y / 2, z / 2]], ["z", [0, 0, z + KNOB_M]]]) {
      const knob = new THREE.Mesh(new THREE.SphereGeometry(KNOB_M * (what === "turn" ? 1 : 0.7), 12, 8), new THREE.MeshBasicMaterial({ color: what === "turn" ? CHOSEN : KNOB, depthTest: false, transparent: true }));
      knob.position.set(...place);
      knob.userData.knob = what;
      this.knobs.add(knob);
    }
    this.knobs.position.set(...body.position_m, 0);
    this.knobs.rotation.z = body.yaw_deg * Math.PI / 180;
  }

  // The robot at "start" (or along a plan) or "goal"; null: not there.
  pose(end, poses) {
    this.figures[end]?.forEach((group, n) => {
      group.visible = Boolean(poses);
      if (poses) put(group, poses, n);
    });
    this.soon();
  }

  points(what, places) {
    what.geometry.dispose();
    what.geometry = new THREE.BufferGeometry().setFromPoints(places.map((place) => new THREE.Vector3(...place)));
    this.soon();
  }
  showPlaces(stances) { this.points(this.places, stances.map((stance) => [stance.position_m[0], stance.position_m[1], 0.004])); }
  showWay(way) { this.points(this.way, Array.from({ length: way.length / 3 }, (_, k) => way.slice(3 * k, 3 * k + 3))); }

  #aim(event) {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    this.ray.setFromCamera(new THREE.Vector2(2 * (event.clientX - left) / width - 1, 1 - 2 * (event.clientY - top) / height), this.camera);
  }

  // What is under the pointer: { knob }, { id } of a body, { end } of the robot, or nothing.
  under(event) {
    this.scene.updateMatrixWorld(); // of what has been made or moved since it was last drawn, too
    this.#aim(event);
    const knob = this.ray.intersectObjects(this.knobs.children)[0];
    if (knob) return { knob: knob.object.userData.knob };
    const visible = (end) => this.figures[end].filter((group) => group.visible);
    const robots = ["start", "goal"].flatMap((end) => this.ray.intersectObjects(visible(end)).map((hit) => ({ hit, end })));
    const holds = this.ray.intersectObjects([...this.made.values()].map((group) => group.children[0])).map((hit) => ({ hit, id: hit.object.userData.id }));
    return [...holds, ...robots].sort((a, b) => a.hit.distance - b.hit.distance)[0] ?? {};
  }

  // Where the pointer meets the plane at a height over the wall: [x, y], or null.
  onWall(event, height_m = 0) {
    this.#aim(event);
    const at = this.ray.ray.intersectPlane(new THREE.Plane(new THREE.Vector3(0, 0, 1), -height_m), new THREE.Vector3());
    return at ? [at.x, at.y] : null;
  }

  // Height over the wall that the pointer shows at a place on it, in the plane that faces the eye.
  heightAt(event, [x, y]) {
    this.#aim(event);
    const foot = new THREE.Vector3(x, y, 0), normal = this.camera.position.clone().sub(foot).setZ(0).normalize();
    const at = this.ray.ray.intersectPlane(new THREE.Plane().setFromNormalAndCoplanarPoint(normal, foot), new THREE.Vector3());
    return at ? at.z : null;
  }

  // Pixels of a point of the wall in the window, for tests and pictures.
  pixel([x, y, z]) {
    this.camera.updateMatrixWorld();
    const at = new THREE.Vector3(x, y, z).project(this.camera), { left, top, width, height } = this.canvas.getBoundingClientRect();
    return [left + (1 + at.x) / 2 * width, top + (1 - at.y) / 2 * height];
  }
}
