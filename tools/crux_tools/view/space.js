// A 3-D view: one recording's robot, plan, forces and wall, by WebGL. Shaded a corner at a time and drawn only when
// something has moved, so that it is quick without a graphics card, too.
"use strict";

const TANGENT = 0.4, NEAR_M = 0.02, FAR_M = 60, SHAFT_M = 0.012, HEAD_M = 0.028, HEAD_LONG_M = 0.025;
const GHOST = [30, 160, 160, 0.32], SKY = [0.965, 0.97, 0.98, 1], SHARP_AFTER_MS = 700;
const FLOATS = 20, STEEPEST = 0.998; // an instance: a matrix and a colour; of the cosine between line of sight and up
const SHADE = `#version 300 es
layout(location = 0) in vec3 corner; layout(location = 1) in vec3 normal;
layout(location = 2) in mat4 place; layout(location = 6) in vec4 rgba;
uniform mat4 camera; uniform vec3 eye; uniform vec3 up;
out vec4 colour;
void main() {
  vec4 at = place * vec4(corner, 1.0);
  vec3 scale = vec3(dot(place[0].xyz, place[0].xyz), dot(place[1].xyz, place[1].xyz), dot(place[2].xyz, place[2].xyz));
  vec3 n = normalize(mat3(place) * (normal / max(scale, 1e-12)));
  float light = 0.62 + 0.22 * dot(n, up) + 0.22 * abs(dot(n, normalize(eye - at.xyz)));
  colour = vec4(rgba.rgb * light, rgba.a);
  gl_Position = camera * at;
}`;
const PAINT = `#version 300 es
precision mediump float;
in vec4 colour; out vec4 pixel;
void main() { pixel = colour; }`;

// Where the views look from: one camera for all of them, so that two logs are seen from the same place.
class Camera {
  constructor(up) { this.up = up; this.target = [0, 0, 0]; this.offset = [1, 0, 0]; this.watching = []; }
  look(target, offset) { this.target = target; this.offset = offset; this.changed(); }
  changed() { for (const tell of this.watching) tell(); }
  axes() {
    const back = unit(this.offset), right = unit(cross(this.up, back));
    return { right, above: cross(back, right), back };
  }
  orbit(dx, dy) {
    const about = (axis, angle, v) => turned([Math.cos(angle / 2), ...times(axis, Math.sin(angle / 2))], v);
    const level = about(this.up, -dx * 0.008, this.offset), right = unit(cross(this.up, level));
    const tilted = about(right, -dy * 0.008, level);
    this.offset = Math.abs(dot(unit(tilted), this.up)) < STEEPEST ? tilted : level;
    this.changed();
  }
  move(dx, dy, height) {
    const { right, above } = this.axes(), scale = 2 * TANGENT * Math.hypot(...this.offset) / height;
    this.target = add(this.target, add(times(right, -dx * scale), times(above, dy * scale)));
    this.changed();
  }
  nearer(factor) { this.offset = times(this.offset, factor); this.changed(); }
}

class Space {
  constructor(box, scene, camera, shows) {
    [this.scene, this.camera, this.shows, this.moment, this.forms] = [scene, camera, shows, null, {}];
    this.canvas = document.createElement("canvas");
    box.append(this.canvas);
    const pen = this.pen = this.canvas.getContext("webgl2", { antialias: false, alpha: false });
    if (!pen) { box.textContent = "No 3-D view: this browser has no WebGL 2. Time line and plots need none."; return; }
    this.begin();
    scene.shapes.forEach((shape, i) => { shape.form = shape.kind === "mesh" ? "mesh" + i : shape.kind; this.add(shape.form, shape); });
    for (const kind of ["cylinder", "cone"]) this.add(kind, { kind });
    camera.watching.push(() => this.soon());
    new ResizeObserver(() => this.soon()).observe(box);
    steer(this.canvas, camera);
  }

  begin() {
    const pen = this.pen, program = this.program = pen.createProgram();
    for (const [kind, text] of [[pen.VERTEX_SHADER, SHADE], [pen.FRAGMENT_SHADER, PAINT]]) {
      const shader = pen.createShader(kind);
      pen.shaderSource(shader, text);
      pen.compileShader(shader);
      pen.attachShader(program, shader);
    }
    pen.linkProgram(program);
    pen.useProgram(program);
    pen.enable(pen.DEPTH_TEST);
    pen.blendFunc(pen.SRC_ALPHA, pen.ONE_MINUS_SRC_ALPHA);
    pen.polygonOffset(1, 2); // the plan lies a little behind what it equals
    this.places = Object.fromEntries(["camera", "eye", "up"].map((name) => [name, pen.getUniformLocation(program, name)]));
  }

  add(name, shape) {
    if (this.forms[name]) return;
    const pen = this.pen, form = formOf(shape), own = pen.createVertexArray();
    pen.bindVertexArray(own);
    [form.corners, form.normals].forEach((table, place) => {
      pen.bindBuffer(pen.ARRAY_BUFFER, pen.createBuffer());
      pen.bufferData(pen.ARRAY_BUFFER, new Float32Array(table), pen.STATIC_DRAW);
      pen.enableVertexAttribArray(place);
      pen.vertexAttribPointer(place, 3, pen.FLOAT, false, 0, 0);
    });
    pen.bindBuffer(pen.ELEMENT_ARRAY_BUFFER, pen.createBuffer());
    pen.bufferData(pen.ELEMENT_ARRAY_BUFFER, new Uint32Array(form.faces), pen.STATIC_DRAW);
    const instances = pen.createBuffer();
    pen.bindBuffer(pen.ARRAY_BUFFER, instances);
    for (let k = 0; k < FLOATS / 4; k++) {
      pen.enableVertexAttribArray(2 + k);
      pen.vertexAttribPointer(2 + k, 4, pen.FLOAT, false, 4 * FLOATS, 16 * k);
      pen.vertexAttribDivisor(2 + k, 1);
    }
    this.forms[name] = { own, instances, count: form.faces.length };
  }

  // Draws another moment at once.
  show(moment) { this.moment = moment; this.draw(); }

  soon() {
    if (!this.waits) this.waits = requestAnimationFrame(() => { this.waits = null; this.draw(); });
  }

  // `sharp`: with at least four pixels for each of the page's, when nothing has moved for a moment; else with one.
  draw(sharp = false) {
    if (!this.pen || !this.moment) return;
    const pen = this.pen, ratio = sharp ? Math.max(window.devicePixelRatio || 1, 2) : 1;
    const width = Math.round(this.canvas.clientWidth * ratio), height = Math.round(this.canvas.clientHeight * ratio);
    if (!width || !height) return;
    if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
    const { right, above, back } = this.camera.axes(), eye = add(this.camera.target, this.camera.offset);
    pen.viewport(0, 0, width, height);
    pen.clearColor(...SKY);
    pen.clear(pen.COLOR_BUFFER_BIT | pen.DEPTH_BUFFER_BIT);
    pen.uniformMatrix4fv(this.places.camera, false, seen(eye, right, above, back, TANGENT, width / height, NEAR_M, FAR_M));
    pen.uniform3fv(this.places.eye, eye);
    pen.uniform3fv(this.places.up, this.camera.up);
    this.paint(this.solids());
    if (this.shows("planned")) this.paintGhost(sharp);
    this.sharp = sharp;
    clearTimeout(this.later);
    if (!sharp) this.later = setTimeout(() => this.draw(true), SHARP_AFTER_MS);
  }

  // Lists of matrices and colours by form.
  solids() {
    const found = {};
    for (const shape of this.scene.shapes) this.put(found, shape, this.moment.measured, this.moment.holds[shape.hold] || shape.rgb, 1);
    for (const [name, rgb] of Object.entries(this.scene.arrows)) {
      const wanted = this.shows(name.endsWith("force") ? "forces" : "moments") && (this.shows("planned") || !name.startsWith("planned"));
      if (wanted) this.moment.grippers.forEach((_, k) => { if (k % 3 === 0) this.putArrow(found, k, this.moment.arrows[name], rgb); });
    }
    return found;
  }

  put(found, shape, poses, rgb, opacity) {
    let place = shape.position, turn = shape.wxyz;
    if (shape.body >= 0) {
      const pose = poses.slice(7 * shape.body, 7 * shape.body + 7), q = pose.slice(3);
      [place, turn] = [add(pose.slice(0, 3), turned(q, place)), both(q, turn)];
    }
    (found[shape.form] ||= []).push(...placed(turn, shape.size, place), rgb[0] / 255, rgb[1] / 255, rgb[2] / 255, opacity);
  }

  putArrow(found, k, vectors, rgb) {
    const tail = this.moment.grippers.slice(k, k + 3), along = vectors.slice(k, k + 3), length = Math.hypot(...along);
    if (length < 1e-4) return;
    const z = unit(along), x = unit(cross(Math.abs(z[0]) < 0.8 ? [1, 0, 0] : [0, 1, 0], z)), y = cross(z, x);
    const head = Math.min(HEAD_LONG_M, length / 2), shaft = length - head, colour = [rgb[0] / 255, rgb[1] / 255, rgb[2] / 255, 1];
    const part = (form, wide, from, long) => (found[form] ||= []).push(
      ...matrix(times(x, wide), times(y, wide), times(z, long), add(tail, times(z, from + long / 2))), ...colour);
    part("cylinder", SHAFT_M, 0, shaft);
    part("cone", HEAD_M, shaft, head);
  }

  // With depth first and colour then only what is nearest of the transparent robot is seen; that takes twice the time.
  paintGhost(sharp) {
    const pen = this.pen, found = {};
    for (const shape of this.scene.shapes) if (shape.body >= 0) this.put(found, shape, this.moment.planned, GHOST, GHOST[3]);
    pen.enable(pen.POLYGON_OFFSET_FILL);
    if (sharp) {
      pen.colorMask(false, false, false, false);
      this.paint(found);
      pen.colorMask(true, true, true, true);
    }
    pen.depthFunc(pen.LEQUAL);
    pen.enable(pen.BLEND);
    this.paint(found);
    pen.disable(pen.BLEND);
    pen.disable(pen.POLYGON_OFFSET_FILL);
    pen.depthFunc(pen.LESS);
  }

  paint(found) {
    const pen = this.pen;
    for (const [name, numbers] of Object.entries(found)) {
      const form = this.forms[name];
      pen.bindVertexArray(form.own);
      pen.bindBuffer(pen.ARRAY_BUFFER, form.instances);
      pen.bufferData(pen.ARRAY_BUFFER, new Float32Array(numbers), pen.STREAM_DRAW);
      pen.drawElementsInstanced(pen.TRIANGLES, form.count, pen.UNSIGNED_INT, 0, numbers.length / FLOATS);
    }
  }
}

// Drag: round what is looked at; with shift or the right button: along; wheel, or two fingers: nearer.
function steer(canvas, camera) {
  const held = new Map();
  const gap = () => { const [a, b] = [...held.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
  canvas.onpointerdown = (event) => {
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
    canvas.setPointerCapture(event.pointerId);
  };
  canvas.onpointermove = (event) => {
    const from = held.get(event.pointerId);
    if (!from) return;
    const before = held.size === 2 ? gap() : 0, dx = event.clientX - from.x, dy = event.clientY - from.y;
    [from.x, from.y] = [event.clientX, event.clientY];
    if (held.size === 2) camera.nearer(before / Math.max(gap(), 1));
    if (held.size === 2 || event.shiftKey || event.buttons & 2) camera.move(dx / held.size, dy / held.size, canvas.clientHeight);
    else camera.orbit(dx, dy);
  };
  canvas.onpointerup = canvas.onpointercancel = (event) => held.delete(event.pointerId);
  canvas.oncontextmenu = (event) => event.preventDefault();
  canvas.onwheel = (event) => { event.preventDefault(); camera.nearer(Math.exp(event.deltaY / 600)); };
}
