// The page's icons: paths in a square of 24, drawn by strokes in the colour of the text.
const PATHS = {
  play: "M7 4l13 8-13 8z", pause: "M8 5v14M16 5v14",
  back: "M15 5l-8 7 8 7", forth: "M9 5l8 7-8 7",
  previous: "M18 5l-9 7 9 7zM6 5v14", next: "M6 5l9 7-9 7zM18 5v14",
  fault: "M12 3l10 18H2zM12 10v5M12 18v.5", whole: "M4 5v14M20 5v14M7 12h10M9 9l-3 3 3 3M15 9l3 3-3 3",
  link: "M10 14a4 4 0 0 0 6 0l4-4a4 4 0 0 0-6-6l-2 2M14 10a4 4 0 0 0-6 0l-4 4a4 4 0 0 0 6 6l2-2",
  theme: "M20 14A8.5 8.5 0 0 1 10 4a8.5 8.5 0 1 0 10 10z",
  help: "M12 21a9 9 0 1 0 0-18 9 9 0 0 0 0 18zM9.5 9.5a2.5 2.5 0 1 1 3.5 2.3c-.7.3-1 .8-1 1.7M12 16.5v.5",
  layout: "M4 4h16v16H4zM4 10h16M10 10v10", camera: "M3 8h4l2-3h6l2 3h4v11H3zM12 17a3.5 3.5 0 1 0 0-7 3.5 3.5 0 0 0 0 7z",
  planned: "M12 3a7 7 0 0 0-7 7v11l3-2 2 2 2-2 2 2 2-2 3 2V10a7 7 0 0 0-7-7zM9.5 10v.5M14.5 10v.5",
  forces: "M5 19L19 5M10 5h9v9", moments: "M20 12a8 8 0 1 1-3-6.2M17 2v4h-4",
  names: "M3 12V4h8l10 9-8 8zM7.500 8v.5", trails: "M4 19c5 0 3-7 8-7s3-7 8-7", frames: "M7 17V4M7 17h13M7 17l-4 4M5 6l2-2 2 2M18 15l2 2-2 2",
  shapes: "M3 11h10v10H3zM16 3l5 9h-10z", wall: "M3 4h18v16H3zM3 9.5h18M3 14.5h18M9 4v5.5M15 9.5v5M9 14.5v5.5",
  reach: "M4 20A16 16 0 0 1 20 4M4 20a9 9 0 0 1 9-9M4 20v.5", measure: "M3 16L16 3l5 5L8 21zM7 12l2 2M10 9l3 3M13 6l2 2",
  follows: "M12 8a4 4 0 1 0 0 8 4 4 0 0 0 0-8zM12 2v4M12 18v4M2 12h4M18 12h4", close: "M6 6l12 12M18 6L6 18", xy: "M5 4v15h15M8 15l4-6 3 3 4-6",
};

export function icon(name) {
  const picture = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  picture.setAttribute("viewBox", "0 0 24 24");
  picture.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", PATHS[name]);
  picture.append(path);
  return picture;
}

// Into every element with data-icon, before its words; its title is what a screen reader says.
export function putIcons() {
  for (const place of document.querySelectorAll("[data-icon]")) {
    place.querySelector("svg")?.remove();
    place.prepend(icon(place.dataset.icon));
    if (place.title && !place.ariaLabel) place.ariaLabel = place.title;
  }
}
