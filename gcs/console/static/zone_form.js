// Form of a no-fly zone: its fields, and the order that they give.

/**
 * @import { LimitReference, Point, VerticalLimits } from "../page_types.d.ts"
 * @import { Disc } from "./canvas.js"
 * @import { Shape } from "./zone_draw_tools.js"
 *
 * @typedef {object} Texts what was typed
 * @property {string} name
 * @property {string} east
 * @property {string} north
 * @property {string} radius
 * @property {string} floor empty: from the ground up
 * @property {string} ceiling empty: up to the sky
 * @property {string} reference empty: not chosen
 *
 * @typedef {Shape & { name: string } & Partial<VerticalLimits>} ZoneOrder
 * @typedef {{ zone: ZoneOrder, mistake?: undefined } | { zone?: undefined, mistake: string }} Found
 */

import { el } from "./dom.js";

const NAME = /^[A-Za-z0-9_.-]{1,64}$/;
const MAX_PLACE_M = 1e7;
const MAX_RADIUS_M = 1e6;
const MAX_HEIGHT_M = 1e5;
const MAX_QUOTED = 20;
const REFERENCES = { "": "choose", ground: "ground", home: "home", msl: "mean sea level" };

/** @type {Record<keyof Texts, string>} */
const LABELS = {
  name: "Name",
  east: "Centre east, m",
  north: "Centre north, m",
  radius: "Radius, m",
  floor: "Floor, m",
  ceiling: "Ceiling, m",
  reference: "Heights above",
};
/** @type {Partial<Record<keyof Texts, string>>} */
const IF_EMPTY = { floor: "from the ground up", ceiling: "unlimited" };

export class ZoneForm {
  /**
   * @param {Texts} texts
   * @param {Point[] | undefined} polygon
   * @param {boolean} isNew false: the zone keeps its name
   */
  constructor(texts, polygon, isNew) {
    this.texts = texts;
    this.polygon = polygon;
    /** @type {Partial<Record<keyof Texts, HTMLInputElement | HTMLSelectElement>>} */
    this.inputs = {};
    /** @type {(keyof Texts)[]} */
    const names = isNew ? ["name"] : [];
    if (!polygon) names.push("east", "north", "radius");
    names.push("floor", "ceiling", "reference");
    this.element = el("div", { class: "fields" }, ...names.flatMap((name) => this.field(name)));
  }

  /** @param {keyof Texts} name */
  field(name) {
    const label = LABELS[name];
    const attributes = { "aria-label": label, placeholder: IF_EMPTY[name] };
    const input =
      name === "reference"
        ? el(
            "select",
            attributes,
            ...Object.entries(REFERENCES).map(([value, text]) => el("option", { value }, text)),
          )
        : el("input", attributes);
    input.value = this.texts[name];
    this.inputs[name] = input;
    return [el("label", {}, label), input];
  }

  /** @returns {Texts} what is in the fields */
  typed() {
    const typed = Object.entries(this.inputs).map(([name, input]) => [name, input.value.trim()]);
    return { ...this.texts, ...Object.fromEntries(typed) };
  }

  /** @returns {Found} */
  read() {
    return zoneOf(this.typed(), this.polygon);
  }
}

/**
 * Return the texts of a zone.
 *
 * @param {string} name
 * @param {Disc | undefined} circle
 * @param {VerticalLimits} [limits]
 * @returns {Texts}
 */
export function textsOf(name, circle, limits) {
  const [east = "", north = "", radius = ""] = (circle ?? []).map(String);
  const isOpen = !limits || (limits.floor_m === null && limits.ceiling_m === null);
  return {
    name,
    east,
    north,
    radius,
    floor: String(limits?.floor_m ?? ""),
    ceiling: String(limits?.ceiling_m ?? ""),
    reference: isOpen ? "" : limits.reference,
  };
}

/**
 * Return the zone of what was typed, or one sentence about the first mistake.
 *
 * @param {Texts} texts
 * @param {Point[]} [polygon]
 * @returns {Found}
 */
export function zoneOf(texts, polygon) {
  if (!NAME.test(texts.name)) return { mistake: "Name: letters, digits, _ . - only." };
  const [east, north] = [metresOf(texts.east), metresOf(texts.north)];
  const radius = metresOf(texts.radius);
  if (!polygon) {
    if (!isWithin(east, MAX_PLACE_M)) return { mistake: expected("Centre east", texts.east, MAX_PLACE_M) };
    if (!isWithin(north, MAX_PLACE_M)) return { mistake: expected("Centre north", texts.north, MAX_PLACE_M) };
    if (!isWithin(radius, MAX_RADIUS_M) || radius <= 0)
      return { mistake: `Radius: expected metres above 0, up to ${MAX_RADIUS_M}${quoted(texts.radius)}.` };
  }
  const heights = heightsOf(texts);
  if (typeof heights === "string") return { mistake: heights };
  /** @type {Shape} */
  const shape = polygon ? { polygon } : { circle: /** @type {Disc} */ ([east, north, radius]) };
  return { zone: { name: texts.name, ...shape, ...heights } };
}

/**
 * Return floor, ceiling and reference as an order has them, or one sentence about the first mistake.
 *
 * @param {Pick<Texts, "floor" | "ceiling" | "reference">} texts
 * @returns {VerticalLimits | {} | string}
 */
function heightsOf(texts) {
  const [floor, ceiling] = [metresOf(texts.floor), metresOf(texts.ceiling)];
  if (floor === null && ceiling === null) return {};
  if (floor !== null && !isWithin(floor, MAX_HEIGHT_M)) return expected("Floor", texts.floor, MAX_HEIGHT_M);
  if (ceiling !== null && !isWithin(ceiling, MAX_HEIGHT_M))
    return expected("Ceiling", texts.ceiling, MAX_HEIGHT_M);
  if (floor !== null && ceiling !== null && floor >= ceiling)
    return `The ceiling, ${ceiling} m, is not above the floor, ${floor} m.`;
  if (!texts.reference) return "Choose what the heights are above: ground, home or mean sea level.";
  if (texts.reference === "ground" && ceiling !== null && ceiling <= 0)
    return `The ceiling, ${ceiling} m, is not above the ground.`;
  if (texts.reference === "ground" && floor !== null && floor < 0)
    return `The floor, ${floor} m, is below the ground: leave it empty to begin on the ground.`;
  return { floor_m: floor, ceiling_m: ceiling, reference: /** @type {LimitReference} */ (texts.reference) };
}

/**
 * Return the number that a text gives: null for none, NaN for something else.
 *
 * @param {string} text
 */
const metresOf = (text) => (text.trim() ? Number(text) : null);

/**
 * @param {number | null} value
 * @param {number} max
 * @returns {value is number}
 */
const isWithin = (value, max) => value !== null && Math.abs(value) <= max;

/**
 * @param {string} label
 * @param {string} text
 * @param {number} max
 */
const expected = (label, text, max) => `${label}: expected metres from ${-max} to ${max}${quoted(text)}.`;

/** @param {string} text */
const quoted = (text) => (text.trim() ? `, not "${text.trim().slice(0, MAX_QUOTED)}"` : "");
