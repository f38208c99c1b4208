// Triangles of the shapes that robots and walls are made of, and vectors, quaternions and matrices to place them.
"use strict";

const ROUND = 16, RINGS = 8;
const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const less = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => times(a, 1 / (Math.hypot(...a) || 1));

// Quaternions are w, x, y, z.
const turned = (q, v) => {
  const axis = [q[1], q[2], q[3]], t = times(cross(axis, v), 2);
  return add(add(v, times(t, q[0])), cross(axis, t));
};
const both = (a, b) => [
  a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3], a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
  a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1], a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
];

// Columns of a 4 × 4 matrix: three axes and a place.
const matrix = (x, y, z, place) => [...x, 0, ...y, 0, ...z, 0, ...place, 1];
const placed = (q, size, place) => matrix(
  turned(q, [size[0], 0, 0]), turned(q, [0, size[1], 0]), turned(q, [0, 0, size[2]]), place);

function product(a, b) {
  const found = [];
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[4 * k + row] * b[4 * column + k];
      found.push(sum);
    }
  return found;
}

// What an eye sees that looks along -z of the frame whose axes are right, above and back.
function seen(eye, right, above, back, tangent, ratio, near, far) {
  const rows = [right, above, back];
  const turn = [0, 1, 2].flatMap((k) => [rows[0][k], rows[1][k], rows[2][k], 0]);
  const look = [...turn, -dot(right, eye), -dot(above, eye), -dot(back, eye), 1];
  const depth = far - near;
  const lens = [1 / (tangent * ratio), 0, 0, 0, 0, 1 / tangent, 0, 0, 0, 0, -(far + near) / depth, -1, 0, 0, -2 * far * near / depth, 0];
  return product(lens, look);
}

function box() {
  const corners = [], normals = [], faces = [];
  for (let axis = 0; axis < 3; axis++)
    for (const side of [-0.5, 0.5]) {
      const first = corners.length / 3, along = [0, 1, 2].map((k) => (k === axis ? 2 * side : 0));
      for (const [u, v] of [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) {
        const corner = [0, 0, 0];
        [corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3]] = [side, u, v];
        corners.push(...corner);
        normals.push(...along);
      }
      faces.push(first, first + 1, first + 2, first, first + 2, first + 3);
    }
  return { corners, normals, faces };
}

// Turned about z: rings of [radius, height, normal outward, normal along z]; two rings span a band where `joined` says so.
function lathe(rings, joined) {
  const corners = [], normals = [], faces = [];
  rings.forEach(([radius, height, outward, along], ring) => {
    for (let k = 0; k <= ROUND; k++) {
      const angle = 2 * Math.PI * k / ROUND, c = Math.cos(angle), s = Math.sin(angle);
      corners.push(radius * c, radius * s, height);
      normals.push(outward * c, outward * s, along);
      if (k === ROUND || !joined(ring)) continue;
      const at = ring * (ROUND + 1) + k, above = at + ROUND + 1;
      faces.push(at, at + 1, above, at + 1, above + 1, above);
    }
  });
  return { corners, normals, faces };
}

// All measure 1 along each axis and are centred.
const FORMS = {
  box,
  cylinder: () => lathe([[0, -0.5, 0, -1], [0.5, -0.5, 0, -1], [0.5, -0.5, 1, 0], [0.5, 0.5, 1, 0], [0.5, 0.5, 0, 1], [0, 0.5, 0, 1]], (ring) => ring % 2 === 0),
  cone: () => lathe([[0, -0.5, 0, -1], [0.5, -0.5, 0, -1], [0.5, -0.5, 0.9, 0.45], [0, 0.5, 0.9, 0.45]], (ring) => ring % 2 === 0),
  sphere: () => lathe(Array.from({ length: RINGS + 1 }, (_, ring) => {
    const angle = Math.PI * (ring / RINGS - 0.5), c = Math.cos(angle), s = Math.sin(angle);
    return [0.5 * c, 0.5 * s, c, s];
  }), (ring) => ring < RINGS),
};

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
const formOf = (shape) => shape.kind !== "mesh" ? FORMS[shape.kind]() : {
  corners: new Float32Array(bytes(shape.corners)), normals: new Float32Array(bytes(shape.normals)),
  faces: new Uint32Array(bytes(shape.faces)),
};
