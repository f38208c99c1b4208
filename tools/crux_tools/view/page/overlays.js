// What a 3-D view shows on demand: names, trails, frames, reach, and distances between points that are clicked on.
import * as THREE from "three";
import { COLOURS } from "./drawing.js";
import { axes, label } from "./frames.js";
import { signal } from "./plots.js";
import { ask, page, rested, view } from "./state.js";

const BODY_COLOUR = "#8a8f98", TRAIL_POINTS = 1500, REACH_M = 0.03, REST_MS = 250, CLICK_PX = 4, MARK_M = 0.006;
const { hypot } = Math;

// Names of holds on their tops, of limbs at their grippers.
export class Labels {
  constructor(space) {
    this.space = space;
    this.holds = space.told.holds.map((hold) => {
      const made = label(hold.name, "hold");
      made.position.fromArray(hold.top);
      return made;
    });
    this.limbs = space.told.grippers.map((name, k) => {
      const made = label(name, "limb");
      made.element.style.borderColor = COLOURS[k];
      return made;
    });
    space.scene.add(...this.holds, ...this.limbs);
  }
  place(moment) {
    this.limbs.forEach((made, k) => made.position.fromArray(moment.grippers, 3 * k).addScaledVector(new THREE.Vector3(0, 0, 1), 0.06));
  }
  choose() { for (const made of [...this.holds, ...this.limbs]) made.visible = this.space.shows("labels"); }
}

// Axes of W, the body and the grippers.
export class Frames {
  constructor(space) {
    this.space = space;
    this.axes = [[space.scene, 0.2, "W"], ...Object.entries(space.told.frames).map(([name, n]) => [space.bodies[n], 0.1, name])]
      .map(([parent, length, name]) => axes(parent, length, space.told.grippers.includes(name) ? "" : name)); // grippers have their names
  }
  choose() { for (const made of this.axes.flat()) made.visible = this.space.shows("frames"); }
}

// Where body and grippers have been since the begin of the range that is shown.
export class Trails {
  constructor(space) {
    this.space = space;
    this.fetch = rested(() => this.#fetch(), REST_MS);
    this.lines = ["body", ...space.told.grippers].map((name, k) => {
      const made = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: k ? COLOURS[k - 1] : BODY_COLOUR }));
      made.frustumCulled = false;
      space.scene.add(made);
      const field = k ? `${name}.limb_telemetry.gripper_position_w_m` : "robot_state.body_position_w_m";
      return { made, field, time_s: [] };
    });
    this.known = false;
  }
  stale() { this.known = false; if (this.space.shows("trails")) this.fetch(); }
  async #fetch() {
    const side = page.spaces.indexOf(this.space);
    this.known = true;
    await Promise.all(this.lines.map(async (line) => {
      const [x, y, z] = (await Promise.all(["x", "y", "z"].map((axis) => signal(`${line.field}_${axis}`, TRAIL_POINTS)))).map((sides) => sides[side]);
      line.time_s = x.time_s.map((time) => time + x.shift_s);
      line.made.geometry.dispose();
      line.made.geometry = new THREE.BufferGeometry().setFromPoints(x.low.map((_, i) => new THREE.Vector3(x.low[i], y.low[i], z.low[i])));
    }));
    this.space.soon();
  }
  choose() {
    const wanted = this.space.shows("trails");
    if (wanted && !this.known) this.fetch();
    for (const line of this.lines) {
      line.made.visible = wanted;
      line.made.geometry.setDrawRange(0, line.time_s.findLastIndex((time) => time <= view.time + 1e-9) + 1);
    }
  }
}

// Where grippers can stand, painted on the wall in the limbs' colours when the time has come to rest.
export class Reach {
  constructor(space) {
    this.space = space;
    this.fetch = rested(() => this.#fetch(), REST_MS);
    this.meshes = space.told.grippers.map((_, k) => {
      const made = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial({
        color: COLOURS[k], transparent: true, opacity: 0.3, depthWrite: false, polygonOffset: true, polygonOffsetFactor: -1 - k, polygonOffsetUnits: -4 * (k + 1),
      }));
      space.scene.add(made);
      return made;
    });
  }
  place() { this.known = false; }
  async #fetch() {
    const found = (await ask(`/reach?time_s=${view.time}&span_s=${view.to - view.from}`))[page.spaces.indexOf(this.space)];
    this.meshes.forEach((made, k) => {
      const places = found[this.space.told.grippers[k]], corners = [], half = REACH_M / 2;
      for (let i = 0; i < places.length; i += 3) {
        const at = (dx, dy) => [places[i] + dx * half, places[i + 1] + dy * half, 0.002];
        corners.push(...at(-1, -1), ...at(1, -1), ...at(1, 1), ...at(-1, -1), ...at(1, 1), ...at(-1, 1));
      }
      made.geometry.dispose();
      made.geometry = new THREE.BufferGeometry().setAttribute("position", new THREE.Float32BufferAttribute(corners, 3));
    });
    this.space.soon();
  }
  choose() {
    const wanted = this.space.shows("reach");
    if (wanted && !this.known) { this.known = true; this.fetch(); }
    for (const made of this.meshes) made.visible = wanted;
  }
}

// Two clicks: the distance between what lies there, and its parts along the axes of W.
export class Measure {
  constructor(space) {
    [this.space, this.marks, this.ray] = [space, new THREE.Group(), new THREE.Raycaster()];
    space.scene.add(this.marks);
    let from = null;
    space.canvas.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; });
    space.canvas.addEventListener("click", (event) => {
      if (from && space.shows("measure") && hypot(event.clientX - from[0], event.clientY - from[1]) < CLICK_PX) this.#take(event);
    });
  }
  #take(event) {
    const { width, height } = this.space.canvas.getBoundingClientRect();
    this.ray.setFromCamera(new THREE.Vector2(2 * event.offsetX / width - 1, 1 - 2 * event.offsetY / height), this.space.camera);
    const solids = [...this.space.scene.children, ...this.space.bodies].filter((each) => each.isMesh || this.space.bodies.includes(each));
    const hit = this.ray.intersectObjects(solids.filter((each) => !this.space.reach.meshes.includes(each)))
      .find((each) => each.object.isMesh);
    if (hit) this.add(hit.point);
  }
  add(point) {
    if (this.points?.length !== 1) { this.clear(); this.points = []; }
    this.points.push(point);
    const mark = new THREE.Mesh(new THREE.SphereGeometry(MARK_M), new THREE.MeshBasicMaterial({ color: 0xe0218a, depthTest: false }));
    mark.position.copy(point);
    mark.renderOrder = 10;
    this.marks.add(mark);
    if (this.points.length === 2) this.#tell(...this.points);
    this.space.soon();
  }
  #tell(a, b) {
    const line = new THREE.Line(new THREE.BufferGeometry().setFromPoints([a, b]), new THREE.LineBasicMaterial({ color: 0xe0218a, depthTest: false }));
    const parts = b.clone().sub(a).toArray().map((x) => (1000 * x).toFixed(1)).join(", ");
    const words = label(`${(1000 * a.distanceTo(b)).toFixed(1)} mm (${parts})`, "measured");
    line.renderOrder = 10;
    words.position.copy(a).add(b).divideScalar(2);
    this.marks.add(line, words);
  }
  clear() {
    for (const made of [...this.marks.children]) made.removeFromParent();
    this.points = [];
  }
  choose() {
    if (!this.space.shows("measure")) this.clear();
  }
}
