// Axes and names of frames in a 3-D view.
import * as THREE from "three";
import { CSS2DObject } from "./three/CSS2DRenderer.js";
import { Arrow } from "./shapes.js";
import { element } from "./state.js";

const AXES = [[1, 0, 0, [214, 48, 49]], [0, 1, 0, [39, 160, 80]], [0, 0, 1, [45, 110, 220]]], AXIS_M = 0.005;

export function label(words, name) {
  const made = new CSS2DObject(element("div", name, words));
  made.center.set(0.5, 1.2);
  return made;
}

// Axes of a length in a frame; without a name, but for `words`.
export function axes(parent, length_m, words) {
  const made = new THREE.Group();
  AXES.forEach(([x, y, z, colour]) => {
    const arrow = new Arrow(colour, Math.min(AXIS_M, length_m / 12));
    arrow.aim([0, 0, 0], [x * length_m, y * length_m, z * length_m]);
    made.add(arrow.group);
  });
  parent.add(made);
  if (!words) return [made];
  const name = label(words, "frame");
  made.add(name);
  return [made, name];
}
