// What every 3-D view has: camera, light, and a picture that three.js draws when something has moved.
import * as THREE from "three";
import { OrbitControls } from "./three/OrbitControls.js";
import { CSS2DRenderer } from "./three/CSS2DRenderer.js";
import { byId } from "./state.js";
import { colour, isDark } from "./theme.js";

const TANGENT = 0.43, WIDEST = 1.15; // of half the field of view upwards, in a view at least as wide as WIDEST of its height
const NEAR_M = 0.02, FAR_M = 60, SHARP_AFTER_MS = 700, COARSE = 0.6, SUN_M = [1.1, 0.7, 2.2], SHADOWED_M = 1.3;
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

export class Stage {
  constructor(box, rig, without) {
    this.box = box;
    try {
      this.slow = isSoftware();
      this.renderer = new THREE.WebGLRenderer({ antialias: !this.slow });
    } catch {
      box.textContent = `No 3-D view: this browser has no WebGL 2. ${without}`;
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
    this.theme();
    rig.add(this.camera, this.controls = new OrbitControls(this.camera, this.canvas));
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

  lightUp(centre) {
    this.sun.target.position.copy(centre);
    this.sun.position.copy(centre).add(new THREE.Vector3(...SUN_M));
  }

  isReady() { return true; } // to be drawn
  choose() {} // what is shown

  soon() {
    if (!this.waits) this.waits = requestAnimationFrame(() => { this.waits = null; this.draw(); });
  }

  // `sharp`: with shadows and fine pixels; where no graphics card draws, only when nothing has moved for a moment.
  draw(sharp = !this.slow) {
    const [width, height] = [this.box.clientWidth, this.box.clientHeight];
    if (!this.renderer || !this.isReady() || !width || !height) return;
    this.choose();
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
