// Replay bar: play, pause, speed, position.

import { el, setText } from "./dom.js";
import { duration } from "./format.js";

const SPEEDS = [0.5, 1, 2, 5, 10, 50];

export class Replay {
  constructor(root, feed) {
    this.root = root;
    this.feed = feed;
    this.dragging = false;
    this.play = el("button", { onclick: () => this.toggle() });
    this.at = el("span");
    this.slider = el("input", { type: "range", min: "0", step: "0.5", "aria-label": "Position in the recording" });
    this.slider.addEventListener("input", () => { this.dragging = true; setText(this.at, this.text(Number(this.slider.value))); });
    this.slider.addEventListener("change", () => { this.dragging = false; this.send({ at_s: Number(this.slider.value) }); });
    this.speed = el("select", { "aria-label": "Speed", onchange: () => this.send({ speed: Number(this.speed.value) }) },
      ...SPEEDS.map((speed) => el("option", { value: speed }, `×${speed}`)));
    this.problem = el("span", { class: "bad", role: "status" });
    root.append(this.play, this.slider, this.at, this.speed, this.problem);
    feed.on(["replay"], () => this.show());
  }

  text(at) {
    return `${duration(at)} / ${duration(this.feed.data.replay.duration_s)}`;
  }

  show() {
    const { replay } = this.feed.data;
    this.root.hidden = !replay;
    if (!replay) return;
    setText(this.play, replay.paused ? "Play" : "Pause");
    if (document.activeElement !== this.speed) this.speed.value = String(replay.speed);
    this.slider.max = String(replay.duration_s ?? replay.at_s);
    if (this.dragging) return;
    this.slider.value = String(replay.at_s);
    setText(this.at, this.text(replay.at_s));
  }

  toggle() {
    if (this.feed.data.replay) this.send({ paused: !this.feed.data.replay.paused });
  }

  async send(wish) {
    setText(this.problem, "");
    const reply = await fetch("/api/replay", {
      method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(wish),
    });
    if (!reply.ok) {
      setText(this.problem, (await reply.json()).error);
      this.show();
    }
  }
}
