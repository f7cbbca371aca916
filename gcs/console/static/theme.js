// Dark or light: the system's choice until the user chooses.

export class Theme extends EventTarget {
  constructor() {
    super();
    this.system = matchMedia("(prefers-color-scheme: light)");
    this.system.addEventListener("change", () => this.apply());
    addEventListener("storage", () => this.apply()); // chosen in another page
    this.apply();
  }

  get name() {
    return localStorage.getItem("theme") ?? (this.system.matches ? "light" : "dark");
  }

  apply() {
    document.documentElement.dataset.theme = this.name;
    const style = getComputedStyle(document.documentElement);
    const colours = new Map(); // reading a style is slow
    this.colour = (name) => {
      if (!colours.has(name)) colours.set(name, style.getPropertyValue(`--${name}`).trim());
      return colours.get(name);
    };
    this.dispatchEvent(new Event("change"));
  }

  toggle() {
    localStorage.setItem("theme", this.name === "light" ? "dark" : "light");
    this.apply();
  }
}
