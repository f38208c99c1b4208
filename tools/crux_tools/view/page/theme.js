// Light or dark: what the system says until somebody chooses; colours by their names in page.css.
const KEPT = "crux-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");
const watching = [];
let known = {};

export const isDark = () => document.documentElement.dataset.theme === "dark";

export function colour(name) {
  return known[name] ||= getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
}

export const onTheme = (act) => watching.push(act);

function take(theme) {
  document.documentElement.dataset.theme = theme;
  known = {};
  watching.forEach((act) => act());
}

export function toggleTheme() {
  const theme = isDark() ? "light" : "dark";
  localStorage.setItem(KEPT, theme);
  take(theme);
}

const wish = () => localStorage.getItem(KEPT) || (dark.matches ? "dark" : "light");
dark.onchange = () => take(wish());
take(wish());
