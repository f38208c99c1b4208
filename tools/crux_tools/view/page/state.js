// What all parts of the page share: the time and range shown, what the server told, and how it is asked.
export const byId = (id) => document.getElementById(id);
export const view = { from: 0, to: 1, time: 0, hover: null, playing: false, shown: 0, connected: false };
export const page = { story: null, known: [], scenes: [], moments: null, spaces: [], rig: null, asking: false, wanted: null };

export async function ask(path) {
  const answer = await fetch("." + path); // below the token in the page's address, where it has one
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

export const isLive = () => page.story.sides[0].what === "live";
export const begin = () => Math.min(...page.story.sides.map((side) => side.begin_s + side.shift_s));
export const end = () => Math.max(...page.story.sides.map((side) => side.end_s + side.shift_s));
export const tag = (number) => page.story.sides.length > 1 ? "AB"[number] + " " : "";
export const events = (serious) => page.known.filter((event) => event.serious || !serious);

export function takeStory(told) {
  page.story = told;
  page.known = told.sides
    .flatMap((side, n) => side.events.map((event) => ({ ...event, at: event.time_s + side.shift_s, tag: tag(n) })))
    .sort((a, b) => a.at - b.at);
}

// Calls `act` when nobody has called for `rest_ms`.
export function rested(act, rest_ms) {
  let waiting = null;
  return () => { clearTimeout(waiting); waiting = setTimeout(act, rest_ms); };
}

// An element with a class, words and children.
export function element(kind, name = "", words = "", ...children) {
  const made = document.createElement(kind);
  if (name) made.className = name;
  if (words) made.textContent = words;
  made.append(...children);
  return made;
}

// A line at the foot of the page that goes away by itself.
export function tell(words) {
  const line = element("div", "toast", words);
  document.body.append(line);
  setTimeout(() => line.remove(), 2500);
}
