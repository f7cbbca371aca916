// Keys of the keyboard. Space holds wherever the focus is, except in dialogs, text fields and checkboxes.

/**
 * @import { Feed } from "./feed.js"
 * @import { Selection } from "./selection.js"
 *
 * @typedef {Record<string, () => void>} Actions by key, in lower case; "shift+" before it
 */

import { vehicleName } from "./format.js";

const DIGITS_MS = 600;
const CHECKBOX = "input[type=checkbox]";
const FIELDS = "input:not([type=checkbox]):not([type=range]), textarea";
const NOT_OF_LISTS = /^[a-z,.? ]$/i; // keys that a list of choices has no use for

/** @type {[key: string, text: string][]} */
export const KEYS = [
  ["1 … 9", "select the vehicle with that number; type 12 for vehicle 12"],
  ["ctrl+A", "select all vehicles"],
  ["Esc", "end the tool, close the layers, or select nothing"],
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
  ["H", "height profile of the selected vehicle"],
  ["L", "layers"],
  ["G", "charts"],
  ["W", "charts: one minute, or the whole run; the pointer draws a span"],
  ["M", "measure"],
  ["P", "play or pause a replay"],
  ["← →", "replay: 5 s back or on; with shift 30 s"],
  ["Home, End", "replay: to its start, its end"],
  [", .", "replay: to the event before, to the next"],
  ["T, shift+T", "select the next or the previous target"],
  ["I", "ignore the selected target, or attend to it"],
  [", .", "lower or raise its priority"],
  ["P, U", "pin the selected vehicles to it, unpin them"],
  ["?", "these keys"],
];

/** Collects the digits of a number that are typed one soon after another. */
export class Digits {
  constructor() {
    this.typed = "";
    this.at = 0;
  }

  /** @param {number} timeMs */
  isOpen(timeMs) {
    return this.typed !== "" && timeMs - this.at < DIGITS_MS;
  }

  /**
   * Add a digit; return the number so far.
   *
   * @param {string} digit
   * @param {number} timeMs
   */
  add(digit, timeMs) {
    this.typed = this.isOpen(timeMs) ? this.typed + digit : digit;
    this.at = timeMs;
    return this.typed;
  }

  /** End the number: a digit after another key begins a new one. */
  end() {
    this.typed = "";
  }
}

/**
 * @param {Actions} actions
 * @param {Feed} feed
 * @param {Selection} selection
 */
export function listenToKeys(actions, feed, selection) {
  const digits = new Digits();

  /** @param {string} name */
  const find = (name) => feed.data.vehicles.find((one) => vehicleName(one.vehicle) === name);

  /** @param {string} digit */
  const select = (digit) => {
    const found = find(digits.add(digit, Date.now())) ?? find(digit);
    leaveChoice();
    if (found) selection.set([found.vehicle]);
  };

  const selectAll = () => {
    leaveChoice();
    selection.set(feed.data.vehicles.filter((one) => one.status !== "lost").map((one) => one.vehicle));
  };

  /** @param {KeyboardEvent} event */
  const actionOf = (event) => {
    const { ctrlKey, metaKey, altKey, shiftKey, key } = event;
    if ((ctrlKey || metaKey) && key === "a") return selectAll;
    if (ctrlKey || metaKey || altKey) return undefined;
    if (/^[1-9]$/.test(key) || (key === "0" && digits.isOpen(Date.now()))) return () => select(key);
    digits.end();
    if (isScrolling(event)) return undefined;
    const name = key.toLowerCase();
    return (shiftKey && actions[`shift+${name}`]) || actions[name];
  };

  addEventListener("keydown", (event) => {
    if (isDialogOpen() || isIn(event, FIELDS)) return;
    if (isIn(event, "select")) {
      if (!NOT_OF_LISTS.test(event.key)) return;
      leaveChoice();
    }
    if (event.key === " ") {
      digits.end();
      if (!event.shiftKey && isIn(event, CHECKBOX)) return;
      event.preventDefault(); // else a focused button would be pressed
      if (!event.repeat) actions[event.shiftKey ? "shift+space" : "space"]();
      return;
    }
    const action = actionOf(event);
    if (!action) return;
    event.preventDefault();
    action();
  });

  addEventListener("keyup", (event) => {
    // Browsers press a focused button when space is released.
    if (event.key === " " && isIn(event, "button") && !isDialogOpen()) event.preventDefault();
  });
}

/** Take the focus from a checkbox or a list of choices: the next keys are for vehicles, map or replay. */
function leaveChoice() {
  const focused = document.activeElement;
  if (focused instanceof HTMLElement && focused.matches(`${CHECKBOX}, select`)) focused.blur();
}

function isDialogOpen() {
  return document.querySelector("dialog[open]") !== null;
}

/**
 * Return true if the focus is in an element that these keys scroll.
 *
 * @param {KeyboardEvent} event
 */
function isScrolling(event) {
  const isMove = /^(Arrow|Home|End)/.test(event.key);
  return isMove && event.target !== document.body && !isIn(event, "#replay *");
}

/**
 * @param {Event} event
 * @param {string} selector
 */
function isIn({ target }, selector) {
  return target instanceof Element && target.matches(selector);
}
