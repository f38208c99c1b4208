// A 3-D view of one recording: robot, plan, forces and wall.
import * as THREE from "three";
import { Arrow, formOf, rgb, solid, wall } from "./shapes.js";
import { Frames, Labels, Measure, Reach, Trails } from "./overlays.js";
import { bodiesOf, ghostsOf, put } from "./bodies.js";
import { Stage } from "./stage.js";

const GHOST_OPACITY = 0.4, SAME_M = 0.002, OFF_M = 0.006, RAD_M = 0.1; // rotations count RAD_M a radian

export class Space extends Stage {
  constructor(box, scene, rig, shows, what) {
    super(box, rig, "Time line and plots need none.");
    [this.told, this.shows, this.what, this.moment] = [scene, shows, what, null];
    if (!this.renderer) {
      this.trails = { stale() {} };
      return;
    }
    this.#build(scene);
    this.labels = new Labels(this);
    this.frames = new Frames(this);
    this.trails = new Trails(this);
    this.reach = new Reach(this);
    this.measure = new Measure(this);
  }

  #build(scene) {
    [this.bodies, this.ghosts] = [bodiesOf(scene.shapes), ghostsOf(scene.shapes)];
    this.holds = new Map(); // hold -> materials of its faces, with their own colours
    for (const shape of scene.shapes.filter((each) => each.body < 0)) {
      if (shape.kind === "plane") { this.scene.add(wall(shape, this.slow)); continue; }
      const material = new THREE.MeshLambertMaterial({ color: rgb(shape.rgb) });
      this.scene.add(solid(shape, formOf(shape), material));
      if (shape.hold >= 0) this.holds.set(shape.hold, [...this.holds.get(shape.hold) || [], { material, own: rgb(shape.rgb) }]);
    }
    this.scene.add(...this.bodies, ...this.ghosts.map((ghost) => ghost.group));
    this.arrows = Object.entries(scene.arrows).map(([name, rgb255]) => {
      const arrows = scene.grippers.map(() => new Arrow(rgb255));
      this.scene.add(...arrows.map((arrow) => arrow.group));
      return { name, arrows };
    });
  }

  // Draws another moment at once.
  show(moment) {
    this.moment = moment;
    if (!this.renderer) return;
    this.#place();
    this.draw();
  }

  #place() {
    const { measured, planned, holds, grippers } = this.moment, centre = new THREE.Vector3(...this.moment.body);
    this.bodies.forEach((body, n) => put(body, measured, n));
    this.ghosts.forEach((ghost, n) => {
      put(ghost.group, planned, n);
      const off_m = ghost.group.position.distanceTo(this.bodies[n].position)
        + RAD_M * ghost.group.quaternion.angleTo(this.bodies[n].quaternion);
      ghost.off = Math.min(Math.max((off_m - SAME_M) / (OFF_M - SAME_M), 0), 1); // where they are the same there is but one
      ghost.paint.opacity = GHOST_OPACITY * ghost.off;
    });
    for (const { name, arrows } of this.arrows)
      arrows.forEach((arrow, k) => arrow.aim(grippers.slice(3 * k, 3 * k + 3), this.moment.arrows[name].slice(3 * k, 3 * k + 3)));
    for (const [hold, faces] of this.holds)
      for (const { material, own } of faces) material.color.copy(holds[hold] ? rgb(holds[hold]) : own);
    this.lightUp(centre);
    this.labels.place(this.moment);
    this.reach.place();
  }

  isReady() { return Boolean(this.moment); }

  choose() {
    const planned = this.shows("planned"), isPlan = this.what === "plan"; // which has nothing measured
    for (const ghost of this.ghosts) ghost.group.visible = planned && ghost.off > 0;
    for (const { name, arrows } of this.arrows) {
      const wanted = this.shows(name.endsWith("force") ? "forces" : "moments") && (name.startsWith("planned") ? planned || isPlan : !isPlan);
      for (const arrow of arrows) arrow.shaft.visible = arrow.head.visible = wanted;
    }
    for (const overlay of [this.labels, this.frames, this.trails, this.reach, this.measure]) overlay.choose();
  }
}
