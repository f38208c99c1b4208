// Layouts by name, kept by this browser: the plots, and what the 3-D view shows.
import { byId, element } from "./state.js";
import { plotsAsWords, takePlots } from "./plots.js";
import { icon } from "./icons.js";
import { remember } from "./timeline.js";

const KEPT = "crux-layouts";
const kept = () => JSON.parse(localStorage.getItem(KEPT) || "{}");
const boxes = () => [...byId("shown").querySelectorAll("input")];

function keep(layouts) {
  localStorage.setItem(KEPT, JSON.stringify(layouts));
  list();
}

function use(layout) {
  takePlots(layout.plots);
  for (const box of boxes())
    if (box.checked !== layout.shown.includes(box.id)) box.click();
  byId("layout").open = false;
  remember();
}

function list() {
  byId("layouts").replaceChildren(...Object.entries(kept()).map(([name, layout]) => {
    const take = element("button", "", name), remove = element("button", "", "", icon("close"));
    take.onclick = () => use(layout);
    remove.title = `delete ${name}`;
    remove.onclick = () => { const { [name]: _, ...left } = kept(); keep(left); };
    return element("div", "", "", take, remove);
  }));
}

export function listenLayouts() {
  byId("saving").onsubmit = (event) => {
    event.preventDefault();
    const shown = boxes().filter((box) => box.checked).map((box) => box.id);
    keep({ ...kept(), [byId("called").value]: { plots: plotsAsWords(), shown } });
    byId("called").value = "";
  };
  list();
}
