// Header: which run, when, and whether its data is fresh. What is bad says so in a word, too.

/**
 * @import { MissionInfo, SensorRecord, ServiceState } from "../page_types.d.ts"
 * @import { Feed } from "./feed.js"
 * @import { Freshness } from "./freshness.js"
 * @import { Theme } from "./theme.js"
 */

import { el, setClass, setText } from "./dom.js";
import { duration, megabytes, number, seconds, utc } from "./format.js";

const SLOW_S = 0.2;
const BEHIND_S = 0.5;
const MAX_SENSORS = 6;
const MAX_NAMED = 2;
const URGENCY = { silent: 0, late: 1, "": 2 };
const STYLES = { silent: "bad", late: "fair", "": "" };

class Item {
  /** @param {string} label */
  constructor(label) {
    this.value = el("span");
    this.element = el("span", { class: "item" }, el("span", {}, label), this.value);
  }

  /**
   * @param {string} text
   * @param {string} style
   */
  show(text, style = "") {
    setText(this.value, text);
    setClass(this.value, style);
  }
}

/**
 * @param {HTMLElement} root
 * @param {Feed} feed
 * @param {Theme} theme
 * @param {Freshness} freshness
 * @param {() => void} showHelp
 */
export function showHeader(root, feed, theme, freshness, showHelp) {
  const name = el("h1", { class: "name" });
  const tag = el("span", { class: "tag" });
  const time = new Item("UTC");
  const elapsed = new Item("elapsed");
  const scans = new Item("scans");
  const lag = new Item("lag");
  const recording = new Item("recording");
  const stations = new Item("other stations");
  const link = el("span", { class: "item", role: "status" });
  const preflight = el(
    "a",
    { href: "/preflight.html", target: "_blank", rel: "noopener", hidden: true },
    "Preflight",
  );
  const mode = el("button", { id: "theme", title: "Dark or light", onclick: () => theme.toggle() }, "Theme");
  const help = el("button", { id: "help", title: "Keys (?)", onclick: showHelp }, "Keys");
  const items = [time, elapsed, scans, lag, recording, stations].map(({ element }) => element);
  const actions = el("span", { class: "actions" }, preflight, mode, help);
  root.append(name, tag, ...items, link, el("span", { class: "space" }), actions);

  feed.on("mission", (mission) => {
    setText(name, mission.name);
    name.title = `${mission.name}, terrain ${mission.terrain}`;
    setText(tag, feed.role === "view" ? `${kindOf(mission)}, VIEW ONLY` : kindOf(mission));
    preflight.hidden = !mission.preflight;
    document.title = `${mission.name} – swarm-gcs`;
  });

  feed.on("head", (head) => {
    const { service } = head;
    time.show(utc(head.t_ms));
    elapsed.show(duration(head.elapsed_s) + (head.ended ? ", mission ended" : ""));
    scans.value.replaceChildren(...sensorParts(head.sensors));
    for (const one of [lag, recording, stations]) one.element.hidden = !service;
    if (!service) return;
    lag.show(...lagText(service));
    recording.show(...recordingText(service));
    const others = service.stations;
    stations.element.hidden = !others.length;
    stations.element.title = others.join("\n");
    stations.show(others.length > MAX_NAMED ? String(others.length) : others.join(", "));
  });

  freshness.addEventListener("change", () => {
    const { problem, since } = freshness;
    const when = since ? ` since ${since}` : "";
    setText(link, problem && `${problem}${when}: what you see is old`);
    setClass(link, problem ? "item bad" : "item");
  });
}

/** @param {MissionInfo} mission */
function kindOf({ kind, speed }) {
  if (kind === "replay") return "REPLAY";
  return speed === 1 ? "LIVE" : `LIVE ×${speed}`;
}

/** @param {SensorRecord[]} sensors */
function sensorParts(sensors) {
  if (!sensors.length) return [el("span", { class: "fair" }, "none yet")];
  const sorted = [...sensors].sort((a, b) => URGENCY[a.state] - URGENCY[b.state]);
  const parts = sorted.slice(0, MAX_SENSORS).map(({ name, scan_age_s: age, state }) => {
    const text = `${name} ${age === null ? "never" : seconds(age)}`;
    const style = `sensor ${STYLES[state]}`;
    return el("span", { class: style, title: name }, state ? `${text} ${state.toUpperCase()}` : text);
  });
  const more = sensors.length - parts.length;
  return more ? [...parts, el("span", { class: "sensor" }, `+${more}`)] : parts;
}

/**
 * @param {ServiceState} service
 * @returns {[text: string, style: string]}
 */
function lagText({ lag_s: lag, dropped }) {
  const word = lag > BEHIND_S ? " BEHIND" : lag > SLOW_S ? " SLOW" : "";
  const style = dropped || lag > BEHIND_S ? "bad" : word ? "fair" : "";
  return [number(lag, 2, " s") + word + (dropped ? `, ${dropped} events DROPPED` : ""), style];
}

/**
 * @param {ServiceState} service
 * @returns {[text: string, style: string]}
 */
function recordingText({ is_recording: isRecording, space }) {
  if (!isRecording) return ["OFF", "bad"];
  if (space === null) return ["on", ""];
  const { used_bytes: used, free_bytes: free, is_low: isLow } = space;
  return [
    `${megabytes(used / 1e6)}, ${megabytes(free / 1e6)} free${isLow ? " LOW" : ""}`,
    isLow ? "bad" : "",
  ];
}
