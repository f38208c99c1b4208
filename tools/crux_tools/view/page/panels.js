// The column beside the 3-D view: a moment in words and figures, the joints, the events and the names of signals.
import { byId, element, page, tag, view } from "./state.js";
import { addPlot } from "./plots.js";
import { remember, seek } from "./timeline.js";

const NEAR_LIMIT = 0.05; // of a joint's range, from where on it is red

export const usedColour = (share) => {
  const scale = page.scenes[0].used_rgb, above = Math.max(scale.findIndex(([end]) => share <= end), 1);
  const [[from, a], [to, b]] = share > 1 ? [scale.at(-2), scale.at(-1)] : [scale[above - 1], scale[above]];
  const part = Math.min((share - from) / (to - from), 1);
  return `rgb(${a.map((x, k) => Math.round(x + (b[k] - x) * part)).join(" ")})`;
};

export function showLegend() {
  const scale = page.scenes[0].used_rgb.map(([share, rgb]) => `rgb(${rgb.join(" ")}) ${100 * share}%`).join(", ");
  const bar = element("i", "scale");
  bar.style.background = `linear-gradient(90deg, ${scale})`;
  const arrow = (name, words) => {
    const line = element("span", "", words);
    line.prepend(element("i", "arrow"));
    line.firstChild.style.background = `rgb(${page.scenes[0].arrows[name].join(" ")})`;
    return line;
  };
  const planned = arrow("planned force", "planned force");
  const arrows = page.story.sides[0].what === "plan" ? [planned] : [arrow("measured force", "measured force"), planned];
  byId("legend").replaceChildren(
    element("span", "", "Holds: share of the limit surface used"),
    element("span", "", "", element("small", "", "0 %"), bar, element("small", "", "100 %: slips")), ...arrows);
  byId("legend").title = "demand of shear and twist over friction times normal force, of the finger nearer to slipping";
}

export function showCaptions(sides) {
  byId("captions").replaceChildren(...sides.map((side, n) => {
    const [head, ...lines] = side.lines;
    const rows = side.limbs.map((limb) => {
      const used = element("td", "number", limb.used === null ? "–" : `${Math.round(100 * limb.used)} %`);
      if (limb.used !== null) used.style.boxShadow = `inset 4px 0 ${usedColour(limb.used)}`;
      const cells = [limb.hold, limb.phase].map((words) => element("td", "", words || "–"));
      const numbers = [limb.margin_n, limb.squeeze_n].map((x) => element("td", "number", x === null ? "–" : `${x.toFixed(1)} N`));
      return element("tr", "", "", element("th", "", limb.name), ...cells, used, ...numbers);
    });
    const heads = ["", "hold", "phase", "used", "margin", "squeeze"].map((words) => element("th", "", words));
    return element("div", "", "", element("b", "", tag(n) + head), ...lines.map((line) => element("p", "", line)),
      element("table", "", "", element("tr", "", "", ...heads), ...rows));
  }));
  if (byId("joints").open) showJoints();
}

// Every joint's angle between its limits, of the first side.
export function showJoints() {
  const box = byId("joints").lastElementChild;
  if (!box.childElementCount)
    box.append(...page.scenes[0].joints.map((joint) => element("div", "joint", "", element("span", "", joint.name),
      element("span", "bar", "", element("i")), element("span", "number"))));
  page.scenes[0].joints.forEach((joint, k) => {
    const [low, high] = joint.limits, angle = page.moments[0].joints[k], share = (angle - low) / (high - low);
    const [, bar, words] = box.children[k].children;
    bar.firstChild.style.left = `${100 * Math.min(Math.max(share, 0), 1)}%`;
    box.children[k].classList.toggle("near", Math.min(share, 1 - share) < NEAR_LIMIT);
    words.textContent = `${(angle * 180 / Math.PI).toFixed(1)}°`;
    box.children[k].title = `${joint.name}: ${angle.toFixed(3)} rad, limits ${low.toFixed(2)} to ${high.toFixed(2)} rad`;
  });
}

export function listEvents() {
  const box = byId("events");
  if (box.childElementCount === page.known.length) return;
  box.replaceChildren(...page.known.map((event) => {
    const line = element("div", event.serious ? "serious" : "", "", element("time", "", event.at.toFixed(2)), event.tag + event.text);
    line.onclick = () => seek(event.at);
    return line;
  }));
  markEvent();
}

export function markEvent() {
  const box = byId("events"), now = page.known.findLastIndex((event) => event.at <= view.time + 1e-4);
  if (box.now === box.children[now]) return;
  if (box.now) box.now.classList.remove("now");
  box.now = box.children[now];
  if (!box.now) return;
  box.now.classList.add("now");
  box.scrollTop = box.now.offsetTop - box.offsetTop - box.clientHeight / 2;
}

export function listSignals() {
  const words = byId("filter").value.toLowerCase().split(/\s+/);
  const found = Object.entries(page.story.signals).filter(([name]) => words.every((word) => name.toLowerCase().includes(word)));
  byId("signals").replaceChildren(...found.map(([name, unit]) => {
    const line = element("div", "", name, element("small", "", unit));
    line.draggable = true;
    line.ondragstart = (event) => event.dataTransfer.setData("text/plain", name);
    line.ondblclick = () => { addPlot([name]); remember(); };
    return line;
  }));
}
