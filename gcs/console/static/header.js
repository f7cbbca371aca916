// Header: which run, when, and whether its data is fresh.

import { el, setClass, setText } from "./dom.js";
import { duration, number } from "./format.js";

const OLD_SCAN_S = 3;
const LAG_S = 0.5;
const SILENT_MS = 2500;

export function showHeader(root, feed, theme) {
  const item = (label) => {
    const value = el("span");
    const element = el("span", { class: "item" }, el("span", {}, label), value);
    return { element, value };
  };
  const name = el("h1", { class: "name" });
  const tag = el("span", { class: "tag" });
  const utc = item("UTC");
  const elapsed = item("elapsed");
  const scans = item("scans");
  const lag = item("lag");
  const recording = item("recording");
  const link = el("span", { class: "item", role: "status" });
  const help = el("button", { id: "help", title: "Keys (?)" }, "Keys");
  const mode = el("button", { title: "Dark or light", onclick: () => theme.toggle() }, "Dark / light");
  root.append(
    name, tag, utc.element, elapsed.element, scans.element, lag.element, recording.element,
    link, el("span", { class: "space" }), mode, help,
  );

  feed.on(["mission"], ({ mission }) => {
    setText(name, mission.name);
    const kind = mission.kind === "live" ? (mission.speed === 1 ? "LIVE" : `LIVE ×${mission.speed}`) : "REPLAY";
    setText(tag, feed.role === "view" ? `${kind}, VIEW ONLY` : kind);
    document.title = `${mission.name} – swarm-gcs`;
    recording.element.hidden = lag.element.hidden = mission.kind !== "live";
  });

  feed.on(["head"], ({ head }) => {
    setText(utc.value, new Date(head.t_ms).toISOString().slice(11, 19));
    setText(elapsed.value, duration(head.elapsed_s) + (head.ended ? ", mission ended" : ""));
    const ages = head.sensors.map((one) => `${one.name} ${one.age_s === null ? "never" : number(one.age_s, 1, " s")}`);
    setText(scans.value, ages.join(", ") || "none");
    const isOld = head.sensors.some((one) => one.age_s === null || one.age_s > OLD_SCAN_S);
    setClass(scans.value, isOld ? "bad" : "");
    setText(lag.value, number(head.lag_s, 2, " s") + (head.dropped ? `, ${head.dropped} dropped` : ""));
    setClass(lag.value, head.lag_s > LAG_S || head.dropped ? "bad" : "");
    setText(recording.value, head.recording ? "on" : "off");
    setClass(recording.value, head.recording ? "" : "bad");
  });

  const showLink = () => {
    const isSilent = Date.now() - feed.heardAt > SILENT_MS && feed.data.mission?.kind === "live";
    if (feed.connected && !isSilent) {
      setText(link, "");
      setClass(link, "item");
      return;
    }
    const when = feed.heardAt ? ` since ${new Date(feed.heardAt).toISOString().slice(11, 19)}` : "";
    setText(link, feed.connected ? `no data${when}` : `no connection${when}: what you see is old`);
    setClass(link, "item bad");
  };
  feed.addEventListener("lost", showLink);
  feed.addEventListener("data", showLink);
  setInterval(showLink, 1000);
}
