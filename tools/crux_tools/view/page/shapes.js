// Solids of the scene as three.js draws them: robot and holds from the server's description, and the wall.
import * as THREE from "three";

const ROUND = 28, PANEL_M = 1.2, HOLE_M = 0.2, PIXELS = 1024, SLAB_M = 0.045;
const UNIT = { // all measure 1 along each axis and are centred
  box: new THREE.BoxGeometry(1, 1, 1),
  cylinder: new THREE.CylinderGeometry(0.5, 0.5, 1, ROUND).rotateX(Math.PI / 2),
  cone: new THREE.ConeGeometry(0.5, 1, ROUND).rotateX(Math.PI / 2),
  sphere: new THREE.SphereGeometry(0.5, ROUND, ROUND / 2),
};

export const rgb = ([r, g, b]) => new THREE.Color().setRGB(r / 255, g / 255, b / 255, THREE.SRGBColorSpace);
export const quaternion = ([w, x, y, z]) => new THREE.Quaternion(x, y, z, w);

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;

export function formOf(shape) {
  if (shape.kind !== "mesh") return UNIT[shape.kind];
  return shape.form ||= meshOf(shape);
}

function meshOf(shape) {
  const form = new THREE.BufferGeometry();
  form.setAttribute("position", new THREE.BufferAttribute(new Float32Array(bytes(shape.corners)), 3));
  form.setAttribute("normal", new THREE.BufferAttribute(new Float32Array(bytes(shape.normals)), 3));
  form.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(shape.faces)), 1));
  return form;
}

// One shape where it is in its body, or in W.
export function solid(shape, form, material) {
  const made = new THREE.Mesh(form, material);
  made.position.fromArray(shape.position);
  made.quaternion.copy(quaternion(shape.wxyz));
  made.scale.fromArray(shape.size);
  made.castShadow = made.receiveShadow = true;
  return made;
}

// Always the same numbers between 0 and 1, so that two pictures of a moment are equal.
function dice() {
  let state = 7;
  return () => (state = (state * 1103515245 + 12345) % 2147483648) / 2147483648;
}

// Painted plywood: panels of 1.2 m with a seam, and a hole for a bolt every 0.2 m.
function panel() {
  const canvas = document.createElement("canvas"), pen = canvas.getContext("2d"), roll = dice();
  canvas.width = canvas.height = PIXELS;
  pen.fillStyle = "#cfccc6";
  pen.fillRect(0, 0, PIXELS, PIXELS);
  for (let k = 0; k < 9000; k++) {
    const light = roll() > 0.5 ? "255,255,255" : "60,55,45", wide = 4 + 40 * roll();
    pen.fillStyle = `rgba(${light},${0.02 + 0.025 * roll()})`;
    pen.fillRect(roll() * PIXELS - 20, roll() * PIXELS, wide, 1 + 2 * roll());
  }
  const holes = PANEL_M / HOLE_M, radius = 0.0055 / PANEL_M * PIXELS;
  for (let row = 0; row < holes; row++)
    for (let column = 0; column < holes; column++) {
      const at = [column + 0.5, row + 0.5].map((k) => k / holes * PIXELS);
      for (const [size, fill] of [[1.7, "#b3afa8"], [1, "#39362f"]]) {
        pen.fillStyle = fill;
        pen.beginPath();
        pen.arc(...at, radius * size, 0, 2 * Math.PI);
        pen.fill();
      }
    }
  pen.fillStyle = "#8f8b83";
  pen.fillRect(0, 0, PIXELS, 2);
  pen.fillRect(0, 0, 2, PIXELS);
  return canvas;
}

// A slab whose front is the wall's surface.
export function wall(shape, slow) {
  const [width, height] = shape.size, texture = new THREE.CanvasTexture(panel());
  texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
  texture.repeat.set(width / PANEL_M, height / PANEL_M);
  texture.colorSpace = THREE.SRGBColorSpace;
  texture.anisotropy = slow ? 1 : 8;
  if (slow) texture.minFilter = THREE.LinearMipmapNearestFilter;
  const front = new THREE.MeshLambertMaterial({ map: texture });
  const edge = new THREE.MeshLambertMaterial({ color: 0xb58e5f });
  const made = new THREE.Mesh(new THREE.BoxGeometry(width, height, SLAB_M), [edge, edge, edge, edge, front, edge]);
  made.position.fromArray(shape.position);
  made.position.z -= SLAB_M / 2;
  made.quaternion.copy(quaternion(shape.wxyz));
  made.receiveShadow = true;
  return made;
}

// An arrow from a point along z, of unit length until `aim` says otherwise.
export class Arrow {
  constructor(colour, width_m = 0.011) {
    this.width_m = width_m;
    const material = new THREE.MeshLambertMaterial({ color: rgb(colour) });
    [this.group, this.shaft, this.head] = [new THREE.Group(), new THREE.Mesh(UNIT.cylinder, material), new THREE.Mesh(UNIT.cone, material)];
    this.group.add(this.shaft, this.head);
  }
  aim(tail, along) {
    const vector = new THREE.Vector3(...along), length = vector.length();
    this.group.visible = length > 1e-4;
    if (!this.group.visible) return;
    const head = Math.min(3 * this.width_m, length / 2), shaft = length - head;
    this.group.position.fromArray(tail);
    this.group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), vector.divideScalar(length));
    this.shaft.scale.set(this.width_m, this.width_m, shaft);
    this.shaft.position.z = shaft / 2;
    this.head.scale.set(2.5 * this.width_m, 2.5 * this.width_m, head);
    this.head.position.z = shaft + head / 2;
  }
}
