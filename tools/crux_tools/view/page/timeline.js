// The page's time: seeking, playing, jumping to events, the range of the time line, and the link that opens it again.
import { ask, begin, byId, end, events, isLive, page, rested, view } from "./state.js";
import { icon } from "./icons.js";
import { draw, fetchSoon, plotsAsWords, point } from "./plots.js";
import { markEvent, showCaptions } from "./panels.js";

const MOST_MS = 100, REST_MS = 150;

export const follows = () => isLive() && byId("follow").checked;

// Moves the 3-D views; while one answer is awaited only the newest wish is kept.
export async function showAt(time) {
  page.wanted = time;
  if (page.asking) return;
  page.asking = true;
  while (page.wanted !== null) {
    const path = page.wanted === "newest" ? "/at" : `/at?time_s=${page.wanted}&span_s=${view.to - view.from}`;
    page.wanted = null;
    try {
      const sides = await ask(path);
      if (path === "/at") view.time = sides[0].time_s, moveRange(sides[0].time_s);
      show(sides);
    } catch (error) {
      console.warn(error);
      byId("captions").textContent = "The viewer has ended.";
      pause();
    }
  }
  page.asking = false;
  point();
}

export function show(sides) {
  const before = page.moments && page.moments[0].body;
  page.moments = sides;
  if (before && byId("follows").checked) page.rig.shift(sides[0].body.map((x, k) => x - before[k]));
  page.spaces.forEach((space, n) => space.show(sides[n]));
  showCaptions(sides);
  view.shown += 1;
}

export function moveRange(time) {
  const width = view.to - view.from;
  if (time > view.to || time < view.from) [view.from, view.to] = [time - width * 0.9, time + width * 0.1], fetchSoon(), draw();
}

export function seek(time) {
  byId("follow").checked = false;
  view.time = Math.min(Math.max(time, begin()), end());
  moveRange(view.time);
  markEvent();
  showAt(view.time);
  point();
  if (!view.playing) remember();
}

// In the address, when the hand has come to rest: browsers refuse to be told hundreds of addresses.
export const remember = rested(rememberNow, REST_MS);

export function rememberNow() {
  const range = `t=${view.time.toFixed(3)}&from=${view.from.toFixed(3)}&to=${view.to.toFixed(3)}`;
  history.replaceState(null, "", `#${range}&plots=${plotsAsWords()}`);
}

export function setRange(from, to) {
  if (to - from < 4 * page.story.sides[0].step_s) return;
  [view.from, view.to] = [from, to];
  fetchSoon();
  draw();
  remember();
}

export const whole = () => setRange(begin(), Math.max(end(), begin() + 1));
export const step = (cycles) => seek(view.time + cycles * page.story.sides[0].step_s);

export function faster(way) {
  const speed = byId("speed");
  speed.selectedIndex = Math.min(Math.max(speed.selectedIndex + way, 0), speed.options.length - 1);
}

export function jump(way, serious) {
  const found = events(serious).filter((event) => way > 0 ? event.at > view.time + 1e-4 : event.at < view.time - 1e-4);
  if (found.length) seek(way > 0 ? found[0].at : found[found.length - 1].at);
}

function showPlaying(playing) {
  view.playing = playing;
  byId("play").replaceChildren(icon(playing ? "pause" : "play"));
}

export function pause() { showPlaying(false); remember(); }

export function play() {
  if (view.playing) { pause(); return; }
  showPlaying(true);
  let last = performance.now();
  const next = (now) => {
    if (!view.playing) return;
    const passed_ms = Math.min(now - last, MOST_MS); // a machine that draws slowly plays slowly, and leaves nothing out
    const time = view.time + passed_ms / 1000 * Number(byId("speed").value);
    last = now;
    seek(time);
    if (time >= end()) pause(); else requestAnimationFrame(next);
  };
  if (view.time >= end() - 1e-6) seek(begin());
  requestAnimationFrame(next);
}
