// Elements without markup: texts from vehicles become text nodes and nothing else.

/**
 * @typedef {string | number | boolean | null | undefined} AttributeValue
 * @typedef {"autocomplete" | "autofocus" | "class" | "disabled" | "height" | "hidden" | "href" | "id" | "max" |
 *   "min" | "placeholder" | "rel" | "role" | "scope" | "src" | "step" | "tabindex" | "target" | "title" | "type" | "value" |
 *   "width"} AttributeName
 * @typedef {{
 *   onclick?: (event: MouseEvent) => void,
 *   onchange?: (event: Event) => void,
 *   onkeydown?: (event: KeyboardEvent) => void,
 * }} Listeners
 * @typedef {{ [name in AttributeName]?: AttributeValue }
 *   & { [name: `aria-${string}` | `data-${string}`]: AttributeValue } & Listeners} Attributes
 * @typedef {Node | string | null | undefined} Child
 */

/**
 * Return a new element. True is an attribute without a value; attributes of false, null and undefined are
 * left out.
 *
 * @template {keyof HTMLElementTagNameMap} Tag
 * @param {Tag} tag
 * @param {Attributes} attributes
 * @param {Child[]} children
 * @returns {HTMLElementTagNameMap[Tag]}
 */
export function el(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function")
      element.addEventListener(name.slice(2), /** @type {EventListener} */ (value));
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined)
      element.setAttribute(name, String(value));
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

/**
 * Return the element of the page with an id.
 *
 * @param {string} id
 */
export function part(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no element "${id}"`);
  return found;
}

/**
 * @param {Element} element
 * @param {string} text
 */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/**
 * @param {Element} element
 * @param {string} name
 */
export function setClass(element, name) {
  if (element.className !== name) element.className = name;
}

/**
 * Return a table with heads: the text and the class of each column.
 *
 * @param {[text: string, name: string][]} heads
 * @param {HTMLElement} body
 * @param {Attributes} attributes
 */
export function tableOf(heads, body, attributes = {}) {
  const cells = heads.map(([text, name]) => el("th", { class: name, scope: "col" }, text));
  return el("table", attributes, el("thead", {}, el("tr", {}, ...cells)), body);
}

/**
 * Keeps one row per key and moves rows only when their order changes, so that focus and pointer stay.
 *
 * @template Item, Key
 * @template {{ element: HTMLElement }} Row
 */
export class Rows {
  /**
   * @param {HTMLElement} parent
   * @param {(item: Item) => Row} make
   * @param {(row: Row, item: Item) => void} update
   * @param {(item: Item) => Key} keyOf
   */
  constructor(parent, make, update, keyOf) {
    this.parent = parent;
    this.make = make;
    this.update = update;
    this.keyOf = keyOf;
    /** @type {Map<Key, Row>} */
    this.rows = new Map();
  }

  /** @param {Item[]} items */
  show(items) {
    const keys = new Set(items.map(this.keyOf));
    for (const [key, row] of this.rows) {
      if (!keys.has(key)) {
        row.element.remove();
        this.rows.delete(key);
      }
    }
    let next = this.parent.firstElementChild;
    for (const item of items) {
      const row = this.rowOf(item);
      this.update(row, item);
      if (row.element === next) next = next.nextElementSibling;
      else this.parent.insertBefore(row.element, next);
    }
  }

  /** @param {Item} item */
  rowOf(item) {
    const key = this.keyOf(item);
    const row = this.rows.get(key) ?? this.make(item);
    this.rows.set(key, row);
    return row;
  }

  /**
   * Mark the selected rows.
   *
   * @param {(key: Key) => boolean} isSelected
   */
  mark(isSelected) {
    for (const [key, row] of this.rows) row.element.setAttribute("aria-selected", String(isSelected(key)));
  }
}
