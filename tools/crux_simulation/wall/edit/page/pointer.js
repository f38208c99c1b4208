// The mouse on the 3-D view: choose, move, turn and resize bodies, add them, drag the robot.
import { add, choose, chosen, moveTo, resizeTo, settle, turnTo, wall } from "./sketch.js";
import * as robot from "./ends.js";

const CLICK_PX = 4, SNAP_DEG = 5, SNAP_M = 0.005;

const toStep = (x, step, event) => event.shiftKey ? x : step * Math.round(x / step);

// The place in the body's own axes.
function local(body, [x, y]) {
  const angle = body.yaw_deg * Math.PI / 180, [dx, dy] = [x - body.position_m[0], y - body.position_m[1]];
  return [Math.cos(angle) * dx + Math.sin(angle) * dy, Math.cos(angle) * dy - Math.sin(angle) * dx];
}

// What a drag does, by what it began on; each is called with the events that follow.
function drags(scene, event, { knob, id, end }) {
  if (end || robot.ends.choosing) {
    if (end && robot.ends.choosing !== end) robot.begin(end);
    if (!robot.ends.choosing) return null;
    const [x, y, z] = robot.ends.at.position_m, from = end ? scene.onWall(event, z) : null;
    return (now) => {
      const at = scene.onWall(now, from ? z : 0);
      if (at && robot.ends.choosing) robot.snap(from ? [x + at[0] - from[0], y + at[1] - from[1]] : at);
    };
  }
  const body = chosen();
  if (knob === "turn") return (now) => {
    const at = scene.onWall(now, body.size_m[2] / 2);
    if (at) turnTo(toStep(Math.atan2(at[1] - body.position_m[1], at[0] - body.position_m[0]) * 180 / Math.PI, SNAP_DEG, now));
  };
  if (knob === "z") return (now) => {
    const height = scene.heightAt(now, body.position_m);
    if (height !== null) resizeTo(2, toStep(height, SNAP_M, now));
  };
  if (knob) return (now) => {
    const at = scene.onWall(now, body.size_m[2] / 2), axis = "xy".indexOf(knob);
    if (at) resizeTo(axis, toStep(2 * Math.abs(local(chosen(), at)[axis]), SNAP_M, now));
  };
  if (id === undefined) return null;
  choose(id);
  const { position_m: [x, y], size_m: [, , top] } = chosen(), from = scene.onWall(event, top);
  return from && ((now) => {
    const at = scene.onWall(now, top);
    if (at) moveTo([x + at[0] - from[0], y + at[1] - from[1]].map((value) => toStep(value, SNAP_M, now)));
  });
}

export function listenPointer(scene) {
  let drag = null, from = null, moved = false, byDrag = false;
  scene.box.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || event.target !== scene.canvas) return;
    const under = scene.under(event), before = robot.ends.choosing;
    drag = under.end && robot.ends.choosing === null && !robot.ends.stances.length ? null : drags(scene, event, under);
    [from, moved, byDrag] = [[event.clientX, event.clientY], false, Boolean(under.end) && before === null];
    settle();
    if (drag) { scene.controls.enabled = false; scene.canvas.setPointerCapture(event.pointerId); }
  }, { capture: true });
  scene.box.addEventListener("pointermove", (event) => {
    if (!from) return;
    moved ||= Math.hypot(event.clientX - from[0], event.clientY - from[1]) > CLICK_PX;
    if (drag && moved) drag(event);
  });
  scene.box.addEventListener("pointerup", (event) => {
    if (!from) return;
    if (!moved && drag && robot.ends.choosing && !byDrag) drag(event);
    if (!moved && !drag && event.target === scene.canvas && wall.chosen !== null) choose(null);
    if (drag && byDrag && robot.ends.choosing) { if (moved) robot.take(); else robot.leave(); }
    [drag, from] = [null, null];
    scene.controls.enabled = true;
    settle();
  });
  scene.box.addEventListener("dblclick", (event) => {
    const under = scene.under(event), at = scene.onWall(event);
    if (at && under.id === undefined && !under.knob && !under.end && !robot.ends.choosing) add(at.map((x) => toStep(x, SNAP_M, event)));
  });
}
