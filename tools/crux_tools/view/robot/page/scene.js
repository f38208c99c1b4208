// The robot in 3-D beside a wall that leans: links, frames, reach, and links that meet. Places are in the body's frame,
// which the group `tilted` turns so that gravity points down.
import * as THREE from "three";
import { bodiesOf, put } from "../bodies.js";
import { COLOURS } from "../drawing.js";
import { axes, label } from "../frames.js";
import { wall } from "../shapes.js";
import { Stage } from "../stage.js";
import { byId } from "../state.js";

const WALL_M = 2.2, FRAME_M = 0.1, JOINT_M = 0.05, PALE = 0.62, BODY = [122, 128, 136], MEETS = 0xd01030, CHOSEN = 0x1f50a0, REACH_OPACITY = 0.28;
const EDGES = [0, 1, 2, 3, 5]; // of the slab: from behind it is not seen
const Y = new THREE.Vector3(0, 1, 0);

const pale = (limb) => new THREE.Color(COLOURS[limb]).lerp(new THREE.Color(0xffffff), PALE).getRGB({}, THREE.SRGBColorSpace);
const paint = (shape) => {
  if (shape.limb < 0) return BODY;
  const { r, g, b } = pale(shape.limb);
  return [r, g, b].map((part) => 255 * part);
};

export class RobotScene extends Stage {
  constructor(box, rig, told) {
    super(box, rig, "Sliders, loads and links that meet need none.");
    if (!this.renderer) return;
    [this.told, this.tilted, this.chosen, this.meeting] = [told, new THREE.Group(), null, new Set()];
    const shapes = told.shapes.map((shape) => shape.kind === "mesh" ? shape : { ...shape, rgb: paint(shape) });
    this.bodies = bodiesOf(shapes);
    const counts = this.bodies.map(() => 0);
    this.solids = shapes.map((shape) => [shape, this.bodies[shape.body].children[counts[shape.body]++]]);
    this.wall = wall({ size: [WALL_M, WALL_M], position: [0, 0, -told.heightM], wxyz: [1, 0, 0, 0] }, this.slow);
    for (const side of EDGES) this.wall.material[side].visible = false;
    this.frames = Object.entries(told.frames).flatMap(([name, n]) => axes(this.bodies[n], n ? JOINT_M : FRAME_M, name));
    this.names = told.limbs.map((limb, k) => {
      const made = label(limb.name, "limb");
      made.element.style.borderColor = COLOURS[k];
      this.bodies[limb.gripper].add(made);
      return made;
    });
    this.reach = told.limbs.map((_, k) => new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshLambertMaterial({
      color: COLOURS[k], transparent: true, opacity: REACH_OPACITY, side: THREE.DoubleSide, depthWrite: false,
    })));
    this.tilted.add(this.wall, ...this.bodies, ...this.reach);
    this.scene.add(this.tilted);
  }

  setReach(limb, { corners, triangles }) {
    const form = this.reach[limb].geometry;
    form.setAttribute("position", new THREE.Float32BufferAttribute(corners, 3));
    form.setIndex(triangles);
    form.computeVertexNormals();
    this.soon();
  }

  show({ poses, meets }, slope_deg) {
    if (!this.renderer) return;
    this.bodies.forEach((body, n) => put(body, poses, n));
    this.tilted.rotation.y = -slope_deg * Math.PI / 180;
    this.lightUp(new THREE.Vector3());
    this.sun.position.applyAxisAngle(Y, this.tilted.rotation.y); // before the wall
    this.meeting = new Set(meets.flatMap((each) => each.bodies));
    this.soon();
  }

  // Shows which link a joint moves; null: none.
  mark(body) {
    this.chosen = body;
    if (this.renderer) this.soon();
  }

  choose() {
    const shown = (id) => byId(id).checked, collides = shown("shapes");
    for (const [shape, solid] of this.solids) {
      solid.visible = shape.layer === "both" || (shape.layer === "collides") === collides;
      solid.material.emissive.setHex(this.meeting.has(shape.body) ? MEETS : shape.body === this.chosen ? CHOSEN : 0);
    }
    for (const made of this.frames) made.visible = shown("frames");
    for (const made of this.names) made.visible = !shown("frames"); // grippers have names among the frames
    for (const made of this.reach) made.visible = shown("reach") && Boolean(made.geometry.index);
    this.wall.visible = shown("wall");
  }

  // Where a body's origin is, as it is drawn, in the frame of the robot's body.
  place(body) {
    this.scene.updateMatrixWorld(true);
    return this.tilted.worldToLocal(this.bodies[body].getWorldPosition(new THREE.Vector3())).toArray();
  }
}
