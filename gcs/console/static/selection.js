// Selected vehicles, and the selected target.

export class Selection extends EventTarget {
  constructor() {
    super();
    this.ids = new Set();
    this.target = null;
  }

  has(id) {
    return this.ids.has(id);
  }

  set(ids) {
    this.ids = new Set(ids);
    this.dispatchEvent(new Event("change"));
  }

  setTarget(name) {
    this.target = name;
    this.dispatchEvent(new Event("change"));
  }

  clear() {
    this.target = null;
    this.set([]);
  }

  toggle(id, add) {
    const others = add ? [...this.ids].filter((one) => one !== id) : [];
    this.set(this.ids.has(id) && (add || this.ids.size === 1) ? others : [...others, id]);
  }

  // Forgets vehicles that are gone; returns the others in the order of their numbers.
  among(vehicles) {
    return vehicles.filter((one) => this.ids.has(one.id)).sort((a, b) => a.id - b.id);
  }
}
