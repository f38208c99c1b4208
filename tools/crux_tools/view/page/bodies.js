// A robot of the server's description: every body a group, their numbers those of the poses.
import * as THREE from "three";
import { formOf, quaternion, rgb, solid } from "./shapes.js";

const GHOST = 0x1f9f9f;

const moving = (shapes) => shapes.filter((shape) => shape.body >= 0);
const count = (shapes) => Math.max(...shapes.map((shape) => shape.body)) + 1;

export function bodiesOf(shapes) {
  const bodies = Array.from({ length: count(shapes) }, () => new THREE.Group());
  for (const shape of moving(shapes))
    bodies[shape.body].add(solid(shape, formOf(shape), new THREE.MeshLambertMaterial({ color: rgb(shape.rgb) })));
  return bodies;
}

// The robot, transparent: with depth first and colour then, so that only the nearest of it is seen, and a little behind
// what it equals. `paint` of each body is its colour.
export function ghostsOf(shapes, colour = GHOST) {
  const behind = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 4 };
  const ghosts = Array.from({ length: count(shapes) }, () => ({
    group: new THREE.Group(),
    depth: new THREE.MeshBasicMaterial({ colorWrite: false, ...behind }),
    paint: new THREE.MeshLambertMaterial({ color: colour, transparent: true, depthWrite: false, ...behind }),
  }));
  for (const shape of moving(shapes)) {
    const { group, depth, paint } = ghosts[shape.body];
    [depth, paint].forEach((material, pass) => {
      const made = solid(shape, formOf(shape), material);
      made.castShadow = made.receiveShadow = false;
      made.renderOrder = 1 + pass;
      group.add(made);
    });
  }
  return ghosts;
}

// A body's group where the poses (x, y, z, then w, x, y, z, each) have it.
export function put(group, poses, n) {
  group.position.fromArray(poses, 7 * n);
  group.quaternion.copy(quaternion(poses.slice(7 * n + 3, 7 * n + 7)));
}
