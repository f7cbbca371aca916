// Pointer on the map: drag, wheel, pinch, click, box; a tool of the map comes first.

import { setText } from "./dom.js";

const CLICK_PX = 5;
const HIT_PX = 18;
const ZOOM_PER_PX = 0.0015;

export class Pointer {
  constructor(map) {
    this.map = map;
    this.pressed = new Map(); // by pointer, of fingers too
    this.start = null;
    this.isDrawing = false; // a tool has the pointer until it is released
    const listen = (type, handler, options) =>
      map.canvas.addEventListener(type, (event) => handler.call(this, event), options);
    listen("pointerdown", this.down);
    listen("pointermove", this.move);
    listen("pointerup", this.up);
    listen("pointercancel", this.up);
    listen("wheel", this.wheel, { passive: false });
  }

  place(event) {
    return this.map.view.place(event.offsetX, event.offsetY);
  }

  down(event) {
    const { canvas, tool } = this.map;
    canvas.setPointerCapture(event.pointerId);
    this.pressed.set(event.pointerId, event);
    this.start = { x: event.offsetX, y: event.offsetY, moved: false, boxes: event.shiftKey && !tool };
    this.isDrawing = Boolean(tool?.drag) && this.pressed.size === 1 && tool.down(this.place(event)) !== false;
  }

  move(event) {
    const { map, start } = this;
    const [east, north] = this.place(event);
    setText(map.place, `E ${east.toFixed(0)}  N ${north.toFixed(0)}`);
    const before = this.pressed.get(event.pointerId);
    if (before && start) this.drag(event, before, start);
    else if (map.tool) map.tool.hover?.([east, north]);
    else return;
    map.redraw();
  }

  drag(event, before, start) {
    const { map } = this;
    const other = [...this.pressed.values()].find((one) => one.pointerId !== event.pointerId);
    this.pressed.set(event.pointerId, event);
    if (Math.hypot(event.offsetX - start.x, event.offsetY - start.y) > CLICK_PX) start.moved = true;
    if (other) this.pinch(other, before, event);
    else if (this.isDrawing) map.tool?.move(this.place(event));
    else if (start.boxes) map.box = [start.x, start.y, event.offsetX, event.offsetY];
    else if (start.moved) map.pan(event.offsetX - before.offsetX, event.offsetY - before.offsetY);
  }

  up(event) {
    const { map, start } = this;
    this.pressed.delete(event.pointerId);
    if (!start) return;
    const isClick = !start.moved && event.type === "pointerup";
    if (map.box) this.selectBox(map.box);
    else if (this.isDrawing) map.tool?.up(this.place(event));
    else if (isClick && map.tool) map.tool.click?.(this.place(event));
    else if (isClick) this.selectAt(event);
    this.start = map.box = null;
    this.isDrawing = false;
    map.redraw();
  }

  wheel(event) {
    event.preventDefault();
    this.map.zoom(Math.exp(-ZOOM_PER_PX * event.deltaY), event.offsetX, event.offsetY);
  }

  pinch(other, before, now) {
    const distance = (event) => Math.hypot(event.offsetX - other.offsetX, event.offsetY - other.offsetY);
    const factor = distance(now) / Math.max(1, distance(before));
    this.map.zoom(factor, (now.offsetX + other.offsetX) / 2, (now.offsetY + other.offsetY) / 2);
  }

  // Vehicles that are drawn, with their places in pixels.
  drawn() {
    const { view, feed } = this.map;
    const placed = (feed.data.vehicles ?? []).filter((one) => one.at && one.status !== "lost");
    return placed.map(({ id, at }) => ({ id, x: view.x(at[0]), y: view.y(at[1]) }));
  }

  drawnTargets() {
    const { view, feed } = this.map;
    return (feed.data.targets ?? []).map(({ name, at }) => ({ name, x: view.x(at[0]), y: view.y(at[1]) }));
  }

  // Where both are, a vehicle comes before a target.
  selectAt(event) {
    const { selection } = this.map;
    const distance = ({ x, y }) => Math.hypot(x - event.offsetX, y - event.offsetY);
    const nearest = (list) =>
      list.filter((one) => distance(one) < HIT_PX).sort((a, b) => distance(a) - distance(b))[0];
    const vehicle = nearest(this.drawn());
    const target = nearest(this.drawnTargets());
    if (vehicle) selection.toggle(vehicle.id, event.shiftKey || event.ctrlKey || event.metaKey);
    else if (target) selection.setTarget(selection.target === target.name ? null : target.name);
    else selection.clear();
  }

  selectBox([x0, y0, x1, y1]) {
    const isBetween = (value, a, b) => value >= Math.min(a, b) && value <= Math.max(a, b);
    const within = this.drawn().filter(({ x, y }) => isBetween(x, x0, x1) && isBetween(y, y0, y1));
    this.map.selection.set(within.map(({ id }) => id));
  }
}
