// Keys. Space holds wherever the focus is, except in dialogs, text fields and checkboxes.

const DIGITS_MS = 600;

export const KEYS = [
  ["1 … 9", "select the vehicle with that number; type 12 for vehicle 12"],
  ["ctrl+A", "select all vehicles"],
  ["Esc", "end the tool, or select nothing"],
  ["space", "hold the selected vehicles"],
  ["shift+space", "hold all"],
  ["R", "resume"],
  ["B", "return to launch (asks)"],
  ["A, D", "arm, disarm (ask)"],
  ["C, Enter", "confirm the checked routes of the plan"],
  ["X, Enter", "reject it"],
  ["K", "acknowledge the worst alarm"],
  ["N", "no-fly zone"],
  ["Z, 0", "zoom to the swarm, to the area"],
  ["F", "follow"],
  ["+ −", "zoom"],
  ["arrows", "move the map"],
  ["V", "details of the selected vehicle, or targets"],
  ["L", "layers"],
  ["G", "charts"],
  ["W", "charts: one minute, or the whole run; the pointer draws a span"],
  ["M", "measure"],
  ["P", "play or pause a replay"],
  ["← →", "replay: 5 s back or on; with shift 30 s"],
  ["Home, End", "replay: to its start, its end"],
  [", .", "replay: to the event before, to the next"],
  ["T, shift+T", "select the next or the last target"],
  ["I", "ignore the selected target, or attend to it"],
  [", .", "lower or raise its priority"],
  ["P, U", "pin the selected vehicles to it, unpin them"],
  ["?", "these keys"],
];

export function listenToKeys(actions, feed, selection) {
  let digits = "";
  let digitAt = 0;
  const select = (digit) => {
    digits = Date.now() - digitAt < DIGITS_MS ? digits + digit : digit;
    digitAt = Date.now();
    const found = (feed.data.vehicles ?? []).find((one) => one.name === digits);
    if (found) selection.set([found.id]);
  };
  addEventListener("keydown", (event) => {
    const inField = event.target.matches("input:not([type=checkbox]):not([type=range]), select, textarea");
    if (document.querySelector("dialog[open]") || inField) return;
    if (event.key === " ") {
      if (!event.shiftKey && event.target.matches("input[type=checkbox]")) return;
      event.preventDefault(); // else a focused button would be pressed
      if (!event.repeat) actions[event.shiftKey ? "shift+space" : "space"]();
      return;
    }
    if ((event.ctrlKey || event.metaKey) && event.key === "a") {
      event.preventDefault();
      selection.set((feed.data.vehicles ?? []).filter((one) => one.status !== "lost").map((one) => one.id));
      return;
    }
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (/^[1-9]$/.test(event.key) || (event.key === "0" && digits && Date.now() - digitAt < DIGITS_MS)) {
      select(event.key);
      return;
    }
    const isScrolling =
      /^(Arrow|Home|End)/.test(event.key) &&
      event.target !== document.body &&
      !event.target.matches("#replay *");
    const key = event.key.toLowerCase();
    const action = (event.shiftKey && actions[`shift+${key}`]) || actions[key];
    if (action && !isScrolling) {
      event.preventDefault();
      action();
    }
  });
  addEventListener("keyup", (event) => {
    // Browsers press a focused button when space is released.
    if (event.key === " " && event.target.matches("button") && !document.querySelector("dialog[open]"))
      event.preventDefault();
  });
}
