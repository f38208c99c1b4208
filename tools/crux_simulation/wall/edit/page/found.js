// What the server finds out about the wall: who reaches which holds, the plan, or why there is none; and its motion.
import { byId, element, rested, tell } from "../state.js";
import { icon } from "../icons.js";
import { chosen, named, choose, onChange, wall } from "./sketch.js";
import { ends, redrawStart, showEnds, takeStances } from "./ends.js";
import { LIMBS } from "./scene.js";
import { ask, send } from "./talk.js";

const REST_MS = 250, AGAIN_MS = 2000, SPEED = 4;
export const found = { reach: null, plan: null, motion: null, looking: true, state: "busy", doing: null, version: -1, problems: [], missing: [] };
let stamp = -1, playedAt = 0;

// Every change is sent when it has come to rest; the server then leaves what it was planning.
const sendSoon = rested(async () => {
  const version = wall.version;
  try {
    const { problems, missing } = await send("/edit", { version, sketch: wall.sketch });
    if (version !== wall.version) return;
    [found.problems, found.missing, found.version] = [problems, missing, Math.max(found.version, version)];
  } catch (error) {
    found.problems = [{ text: error.message, hold: null }];
  }
  show();
}, REST_MS);

export function listenFound() {
  onChange((changed) => {
    if (changed) {
      [found.plan, found.doing, found.state] = [null, null, "busy"];
      stop();
      sendSoon();
    }
    show();
  });
  sendSoon();
  byId("play").onclick = playOrPause;
  byId("time").oninput = () => { pause(); seek(Number(byId("time").value)); };
  listen();
}

async function listen() {
  for (;;) {
    try {
      const told = await ask(`/found?since=${stamp}`);
      if (!told) continue;
      stamp = told.stamp;
      if (told.reach !== undefined) takeReach(told.reach);
      if (told.version === wall.version) take(told);
      show();
    } catch (error) {
      if (document.visibilityState === "visible") tell(error.message);
      await new Promise((resolve) => { setTimeout(resolve, AGAIN_MS); });
    }
  }
}

// What was known before is shown until there is something newer.
function takeReach(reach) {
  found.looking = !reach;
  if (!reach) return;
  found.reach = reach;
  takeStances(reach.stances);
}

async function take(told) {
  [found.state, found.doing, found.version] = [told.state, told.doing, told.version];
  if (JSON.stringify(found.plan) !== JSON.stringify(told.plan)) {
    found.plan = told.plan;
    stop();
  }
  if (!told.moves || found.motion) return;
  const { plan } = found, motion = await ask(`/motion?version=${told.version}`);
  if (found.plan !== plan || found.motion || !motion) return;
  found.motion = motion;
  ends.scene.showWay(motion.way);
  byId("time").max = motion.time_s.at(-1);
  seek(0, false);
  show();
}

export const blamed = () => Object.fromEntries([
  ...found.problems.filter((problem) => problem.hold).map((problem) => [problem.hold, problem.text]),
  ...(found.plan?.holds ?? []).map((name) => [name, found.plan.text.length > 160 ? `${found.plan.text.slice(0, 160)} …` : found.plan.text]),
]);

function show() {
  byId("plan").replaceChildren(...words());
  byId("playing").hidden = !found.motion;
  byId("problems").replaceChildren(...found.problems.map((problem) => {
    const line = element("li", "", problem.text);
    line.onclick = () => choose(named(problem.hold)?.id ?? null);
    return line;
  }));
  showReach();
  ends.scene.set(found.reach, blamed());
  showEnds();
}

function words() {
  const line = (text, name = "") => element("p", name, text), plan = found.plan;
  if (found.problems.length) return [line("This wall is no scenario yet:", "bad")];
  if (plan?.kind === "plan") {
    const proven = plan.gap === null ? "" : `, proven within ${(100 * plan.gap).toFixed(0)} % of the least with as many steps`;
    const margin = plan.margin_n === null ? [] : [line(`least margin of the limit surface ${plan.margin_n.toFixed(1)} N`)];
    return [element("b", "", `J ${plan.cost.toFixed(3)}`), line(`${plan.steps} steps, ${plan.seconds.toFixed(0)} s${proven}`), ...margin];
  }
  if (plan) return [line(plan.verdict ? `No plan: ${plan.verdict}` : "No plan", "bad"), line(plan.text)];
  if (found.state === "busy") {
    if (found.doing) return [line(`planning: ${found.doing.text}, ${Math.round(100 * found.doing.share)} %`)];
    return [line(found.looking ? "looking at who reaches which holds …" : "planning …")];
  }
  const stances = found.reach?.stances.length ?? 0;
  return [line(`${stances} places of the body with a stance`), ...(found.missing.length ? [line(`Still to be set: ${found.missing.join(" and ")}.`)] : [])];
}

// Who grips the chosen hold by which faces, in words.
function showReach() {
  const body = chosen(), pairs = body && !body.obstacle ? found.reach?.holds[body.name] : null;
  byId("reach").replaceChildren(...(pairs ?? []).flatMap((pair) => {
    const limbs = LIMBS.filter((limb) => pair.limbs[limb]).map((limb) => `${limb} ${Math.max(1, Math.round(100 * pair.limbs[limb]))} %`);
    if (!limbs.length) return [element("p", "bad", `faces ${pair.faces}: no, ${pair.reason}`)];
    const others = Object.entries(pair.without).map(([limb, why]) => element("small", "", `not ${limb}: ${why}`));
    return [element("p", "", `faces ${pair.faces}: ${limbs.join(", ")} of the body's places around it${pair.off_centre ? ", off their middle" : ""}`, ...others)];
  }));
}

function seek(time, drawn = true) {
  const { time_s: times, poses } = found.motion, at = Math.max(times.findLastIndex((each) => each <= time + 1e-9), 0);
  byId("time").value = time;
  if (drawn) { ends.playing = true; ends.scene.pose("start", poses[at]); }
}

function pause() {
  playedAt = 0;
  byId("play").replaceChildren(icon("play"));
}

function stop() {
  pause();
  found.motion = null;
  ends.scene.showWay([]);
  if (ends.playing) { ends.playing = false; redrawStart(); }
}

export function playOrPause() {
  if (!found.motion || playedAt) { pause(); return; }
  byId("play").replaceChildren(icon("pause"));
  const last = found.motion.time_s.at(-1);
  if (Number(byId("time").value) >= last - 1e-9) byId("time").value = 0;
  playedAt = performance.now();
  const tick = (now) => {
    if (!playedAt || !found.motion) return;
    const time = Math.min(Number(byId("time").value) + SPEED * Math.max(now - playedAt, 0) / 1000, last);
    playedAt = now;
    seek(time);
    if (time >= last) pause(); else requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}
