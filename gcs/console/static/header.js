// Header: which run, when, and whether its data is fresh. What is bad says so in a word, too.

import { el, setClass, setText } from "./dom.js";
import { duration, megabytes, number, seconds } from "./format.js";

const SLOW_S = 0.2;
const BEHIND_S = 0.5;
const MAX_SENSORS = 6;
const MAX_NAMED = 2;
const URGENCY = { silent: 0, late: 1, "": 2 };
const STYLES = { silent: "bad", late: "fair", "": "" };

function sensorParts(sensors) {
  if (!sensors.length) return [el("span", { class: "fair" }, "none yet")];
  const sorted = [...sensors].sort((a, b) => URGENCY[a.state] - URGENCY[b.state]);
  const parts = sorted
    .slice(0, MAX_SENSORS)
    .map(({ name, age_s: age, state }) =>
      el(
        "span",
        { class: `sensor ${STYLES[state]}`, title: name },
        `${name} ${age === null ? "never" : seconds(age)}${state && ` ${state.toUpperCase()}`}`,
      ),
    );
  if (sensors.length > MAX_SENSORS)
    parts.push(el("span", { class: "sensor" }, `+${sensors.length - MAX_SENSORS}`));
  return parts;
}

function lagText({ lag_s: lag, dropped }) {
  const word = lag > BEHIND_S ? " BEHIND" : lag > SLOW_S ? " SLOW" : "";
  const style = dropped || lag > BEHIND_S ? "bad" : word ? "fair" : "";
  return [number(lag, 2, " s") + word + (dropped ? `, ${dropped} events DROPPED` : ""), style];
}

function recordingText({ recording, used_mb: used, free_mb: free, low }) {
  if (!recording) return ["OFF", "bad"];
  if (free === null) return ["on", ""];
  return [`${megabytes(used)}, ${megabytes(free)} free${low ? " LOW" : ""}`, low ? "bad" : ""];
}

export function showHeader(root, feed, theme, freshness) {
  const item = (label) => {
    const value = el("span");
    const element = el("span", { class: "item" }, el("span", {}, label), value);
    const show = ([text, style]) => {
      setText(value, text);
      setClass(value, style);
    };
    return { element, value, show };
  };
  const name = el("h1", { class: "name" });
  const tag = el("span", { class: "tag" });
  const utc = item("UTC");
  const elapsed = item("elapsed");
  const scans = item("scans");
  const lag = item("lag");
  const recording = item("recording");
  const stations = item("other stations");
  const link = el("span", { class: "item", role: "status" });
  const help = el("button", { id: "help", title: "Keys (?)" }, "Keys");
  const preflight = el(
    "a",
    { href: "/preflight.html", target: "_blank", rel: "noopener", hidden: true },
    "Preflight",
  );
  const mode = el("button", { id: "theme", title: "Dark or light", onclick: () => theme.toggle() }, "Theme");
  root.append(
    name,
    tag,
    utc.element,
    elapsed.element,
    scans.element,
    lag.element,
    recording.element,
    stations.element,
    link,
    el("span", { class: "space" }),
    el("span", { class: "actions" }, preflight, mode, help),
  );

  feed.on(["mission"], ({ mission }) => {
    setText(name, mission.name);
    name.title = mission.name;
    const kind =
      mission.kind === "live" ? (mission.speed === 1 ? "LIVE" : `LIVE ×${mission.speed}`) : "REPLAY";
    setText(tag, feed.role === "view" ? `${kind}, VIEW ONLY` : kind);
    preflight.hidden = !mission.preflight;
    document.title = `${mission.name} – swarm-gcs`;
  });

  feed.on(["head"], ({ head }) => {
    setText(utc.value, new Date(head.t_ms).toISOString().slice(11, 19));
    setText(elapsed.value, duration(head.elapsed_s) + (head.ended ? ", mission ended" : ""));
    scans.value.replaceChildren(...sensorParts(head.sensors));
    const { service } = head;
    for (const one of [lag, recording, stations]) one.element.hidden = !service;
    if (!service) return;
    lag.show(lagText(service));
    recording.show(recordingText(service));
    const others = service.stations;
    stations.element.hidden = !others.length;
    stations.element.title = others.join("\n");
    stations.show([others.length > MAX_NAMED ? String(others.length) : others.join(", "), ""]);
  });

  freshness.addEventListener("change", () => {
    const { problem, since } = freshness;
    const when = since ? ` since ${since}` : "";
    setText(link, problem && `${problem}${when}: what you see is old`);
    setClass(link, problem ? "item bad" : "item");
  });
}
