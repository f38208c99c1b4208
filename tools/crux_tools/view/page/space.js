// A 3-D view of one recording: robot, plan, forces and wall, drawn by three.js when something has moved.
import * as THREE from "three";
import { OrbitControls } from "./three/OrbitControls.js";
import { CSS2DRenderer } from "./three/CSS2DRenderer.js";
import { Arrow, formOf, quaternion, rgb, solid, wall } from "./shapes.js";
import { Frames, Labels, Measure, Reach, Trails } from "./overlays.js";
import { byId } from "./state.js";
import { colour, isDark } from "./theme.js";

const TANGENT = 0.43, WIDEST = 1.15; // of half the field of view upwards, in a view at least as wide as WIDEST of its height
const NEAR_M = 0.02, FAR_M = 60, SHARP_AFTER_MS = 700, COARSE = 0.6, SUN_M = [1.1, 0.7, 2.2], SHADOWED_M = 1.3;
const GHOST = 0x1f9f9f, GHOST_OPACITY = 0.4, SAME_M = 0.002, OFF_M = 0.006, RAD_M = 0.1; // rotations count RAD_M a radian
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software/i;

function isSoftware() {
  const pen = document.createElement("canvas").getContext("webgl2"), named = pen?.getExtension("WEBGL_debug_renderer_info");
  return Boolean(named) && SOFTWARE.test(pen.getParameter(named.UNMASKED_RENDERER_WEBGL));
}

// Where all views look from: one place for all of them, so that two logs are seen alike.
export class Rig {
  constructor(up) { this.up = new THREE.Vector3(...up); this.views = []; }
  add(camera, controls) {
    camera.up.copy(this.up);
    this.views.push([camera, controls]);
    controls.addEventListener("change", () => this.#follow(camera, controls));
  }
  #follow(camera, controls) {
    if (this.leading) return;
    this.leading = true;
    for (const [other, its] of this.views) {
      if (other === camera) continue;
      other.position.copy(camera.position);
      its.target.copy(controls.target);
      its.update();
    }
    this.leading = false;
  }
  look(target, offset) {
    const [camera, controls] = this.views[0];
    controls.target.fromArray(target);
    camera.position.fromArray(target).add(new THREE.Vector3(...offset));
    controls.update();
  }
  shift(moved) {
    const [camera, controls] = this.views[0], by = new THREE.Vector3(...moved);
    controls.target.add(by);
    camera.position.add(by);
    controls.update();
  }
}

export class Space {
  constructor(box, scene, rig, shows, what) {
    [this.box, this.told, this.shows, this.what, this.moment] = [box, scene, shows, what, null];
    try {
      this.slow = isSoftware();
      this.renderer = new THREE.WebGLRenderer({ antialias: !this.slow });
    } catch {
      box.textContent = "No 3-D view: this browser has no WebGL 2. Time line and plots need none.";
      this.trails = { stale() {} };
      return;
    }
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    this.canvas = this.renderer.domElement;
    this.words = new CSS2DRenderer();
    this.words.domElement.className = "labels";
    box.append(this.canvas, this.words.domElement);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(45, 1, NEAR_M, FAR_M);
    this.#light(rig.up);
    this.#build(scene);
    this.labels = new Labels(this);
    this.frames = new Frames(this);
    this.trails = new Trails(this);
    this.reach = new Reach(this);
    this.theme();
    rig.add(this.camera, this.controls = new OrbitControls(this.camera, this.canvas));
    this.measure = new Measure(this);
    this.controls.addEventListener("change", () => this.soon());
    new ResizeObserver(() => this.soon()).observe(box);
  }

  #light(up) {
    this.sky = new THREE.HemisphereLight(0xffffff, 0x9a9488, 1.5);
    this.sky.position.copy(up);
    this.sun = new THREE.DirectionalLight(0xfff4e0, 2.2);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(2048, 2048);
    Object.assign(this.sun.shadow.camera, { left: -SHADOWED_M, right: SHADOWED_M, top: SHADOWED_M, bottom: -SHADOWED_M, near: 0.5, far: 5 });
    this.sun.shadow.normalBias = 0.01;
    this.sun.shadow.radius = 3;
    this.scene.add(this.sky, this.sun, this.sun.target);
  }

  // Robot, and its plan: every body a group, their numbers those of the moments' poses.
  #build(scene) {
    const bodies = Math.max(...scene.shapes.map((shape) => shape.body)) + 1, group = () => new THREE.Group();
    this.bodies = Array.from({ length: bodies }, group);
    this.ghosts = Array.from({ length: bodies }, () => this.#ghost());
    this.holds = new Map(); // hold -> materials of its faces, with their own colours
    for (const shape of scene.shapes) {
      if (shape.kind === "plane") { this.scene.add(wall(shape, this.slow)); continue; }
      const form = formOf(shape), material = new THREE.MeshLambertMaterial({ color: rgb(shape.rgb) });
      const made = solid(shape, form, material);
      if (shape.hold >= 0) this.holds.set(shape.hold, [...this.holds.get(shape.hold) || [], { material, own: rgb(shape.rgb) }]);
      if (shape.body < 0) { this.scene.add(made); continue; }
      this.bodies[shape.body].add(made);
      this.#addToGhost(this.ghosts[shape.body], shape, form);
    }
    this.scene.add(...this.bodies, ...this.ghosts.map((ghost) => ghost.group));
    this.arrows = Object.entries(scene.arrows).map(([name, rgb255]) => {
      const arrows = scene.grippers.map(() => new Arrow(rgb255));
      this.scene.add(...arrows.map((arrow) => arrow.group));
      return { name, arrows };
    });
  }

  // With depth first and colour then, so that only the nearest of the transparent robot is seen, and a little behind what
  // it equals.
  #ghost() {
    const behind = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 4 };
    return {
      group: new THREE.Group(),
      depth: new THREE.MeshBasicMaterial({ colorWrite: false, ...behind }),
      paint: new THREE.MeshLambertMaterial({ color: GHOST, transparent: true, depthWrite: false, ...behind }),
    };
  }

  #addToGhost(ghost, shape, form) {
    [ghost.depth, ghost.paint].forEach((material, pass) => {
      const made = solid(shape, form, material);
      made.castShadow = made.receiveShadow = false;
      made.renderOrder = 1 + pass;
      ghost.group.add(made);
    });
  }

  theme() {
    const canvas = document.createElement("canvas"), pen = canvas.getContext("2d"), fill = pen.createLinearGradient(0, 0, 0, 256);
    [canvas.width, canvas.height] = [2, 256];
    fill.addColorStop(0, colour("sky-top"));
    fill.addColorStop(1, colour("sky-foot"));
    pen.fillStyle = fill;
    pen.fillRect(0, 0, 2, 256);
    this.scene.background = new THREE.CanvasTexture(canvas);
    this.scene.background.colorSpace = THREE.SRGBColorSpace;
    this.sky.intensity = isDark() ? 1.1 : 2.1;
    this.sun.intensity = isDark() ? 1.7 : 2.4;
    this.soon();
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
    this.bodies.forEach((body, n) => this.#put(body, measured, n));
    this.ghosts.forEach((ghost, n) => {
      this.#put(ghost.group, planned, n);
      const off_m = ghost.group.position.distanceTo(this.bodies[n].position)
        + RAD_M * ghost.group.quaternion.angleTo(this.bodies[n].quaternion);
      ghost.off = Math.min(Math.max((off_m - SAME_M) / (OFF_M - SAME_M), 0), 1); // where they are the same there is but one
      ghost.paint.opacity = GHOST_OPACITY * ghost.off;
    });
    for (const { name, arrows } of this.arrows)
      arrows.forEach((arrow, k) => arrow.aim(grippers.slice(3 * k, 3 * k + 3), this.moment.arrows[name].slice(3 * k, 3 * k + 3)));
    for (const [hold, faces] of this.holds)
      for (const { material, own } of faces) material.color.copy(holds[hold] ? rgb(holds[hold]) : own);
    this.sun.target.position.copy(centre);
    this.sun.position.copy(centre).add(new THREE.Vector3(...SUN_M));
    this.labels.place(this.moment);
    this.reach.place();
  }

  #put(group, poses, n) {
    group.position.fromArray(poses, 7 * n);
    group.quaternion.copy(quaternion(poses.slice(7 * n + 3, 7 * n + 7)));
  }

  #choose() {
    const planned = this.shows("planned"), isPlan = this.what === "plan"; // which has nothing measured
    for (const ghost of this.ghosts) ghost.group.visible = planned && ghost.off > 0;
    for (const { name, arrows } of this.arrows) {
      const wanted = this.shows(name.endsWith("force") ? "forces" : "moments") && (name.startsWith("planned") ? planned || isPlan : !isPlan);
      for (const arrow of arrows) arrow.shaft.visible = arrow.head.visible = wanted;
    }
    for (const overlay of [this.labels, this.frames, this.trails, this.reach, this.measure]) overlay.choose();
  }

  soon() {
    if (!this.waits) this.waits = requestAnimationFrame(() => { this.waits = null; this.draw(); });
  }

  // `sharp`: with shadows and fine pixels; where no graphics card draws, only when nothing has moved for a moment.
  draw(sharp = !this.slow) {
    const [width, height] = [this.box.clientWidth, this.box.clientHeight];
    if (!this.renderer || !this.moment || !width || !height) return;
    this.#choose();
    this.camera.aspect = width / height;
    this.camera.fov = 2 * Math.atan(TANGENT * Math.max(1, WIDEST / this.camera.aspect)) * 180 / Math.PI;
    const covered = byId("legend").offsetHeight; // of the view's lower end: the picture is moved up
    this.camera.setViewOffset(width, height, 0, Math.min(covered, height / 4) / 2, width, height);
    const ratio = sharp ? Math.max(window.devicePixelRatio || 1, this.slow ? 2 : 1) : COARSE;
    if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
    if (this.drawn !== `${width} ${height}`) {
      this.renderer.setSize(width, height);
      this.words.setSize(width, height);
      this.drawn = `${width} ${height}`;
    }
    this.sun.castShadow = sharp;
    this.renderer.render(this.scene, this.camera);
    this.words.render(this.scene, this.camera);
    clearTimeout(this.later);
    if (!sharp) this.later = setTimeout(() => this.draw(true), SHARP_AFTER_MS);
  }
}
