// Dark or light: the system's choice until the user chooses.

export class Theme extends EventTarget {
  constructor() {
    super();
    this.system = matchMedia("(prefers-color-scheme: light)");
    /** @type {Map<string, string>} */
    this.colours = new Map(); // reading a style is slow
    /** @type {(name: string) => string} */
    this.colour = (name) => this.colours.get(name) ?? this.read(name);
    this.system.addEventListener("change", () => this.apply());
    addEventListener("storage", () => this.apply()); // chosen in another page
    this.apply();
  }

  get name() {
    return localStorage.getItem("theme") ?? (this.system.matches ? "light" : "dark");
  }

  apply() {
    document.documentElement.dataset.theme = this.name;
    this.colours.clear();
    this.dispatchEvent(new Event("change"));
  }

  /** @param {string} name */
  read(name) {
    const colour = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    this.colours.set(name, colour);
    return colour;
  }

  toggle() {
    localStorage.setItem("theme", this.name === "light" ? "dark" : "light");
    this.apply();
  }
}
