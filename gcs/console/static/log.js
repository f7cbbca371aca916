// Events of the run, those that are warnings or alarms, and orders with their answers, newest last.

import { el, setText } from "./dom.js";
import { duration } from "./format.js";

const MAX_SHOWN = 300;
const NEAR_END_PX = 30;

const isAnswer = ({ kind }) => kind === "OrderAnswer";
const LISTS = {
  events: ["Events", (entry) => !isAnswer(entry)],
  warnings: ["Warnings", (entry) => !isAnswer(entry) && entry.level !== "info"],
  orders: ["Orders", isAnswer],
};

export function showLog(root, feed) {
  const [lists, panels, tabs] = [{}, {}, {}];
  const choose = (chosen) => {
    for (const [name, one] of Object.entries(panels)) {
      one.hidden = name !== chosen;
      tabs[name].setAttribute("aria-selected", String(name === chosen));
    }
    panels[chosen].scrollTop = panels[chosen].scrollHeight;
  };
  for (const [name, [title]] of Object.entries(LISTS)) {
    lists[name] = el("ol");
    panels[name] = el("div", { class: "panel", role: "tabpanel", tabindex: "0", "aria-label": title }, lists[name]);
    tabs[name] = el("button", { role: "tab", onclick: () => choose(name) }, title);
  }
  root.append(el("div", { class: "tabs", role: "tablist" }, ...Object.values(tabs)), ...Object.values(panels));
  choose("events");

  const append = (name, entries, fresh) => {
    const [list, scrolled] = [lists[name], panels[name]];
    const isAtEnd = scrolled.scrollHeight - scrolled.scrollTop - scrolled.clientHeight < NEAR_END_PX;
    if (fresh) list.replaceChildren();
    list.append(...entries.map(({ t_s, level, text }) =>
      el("li", { class: level }, el("time", {}, duration(t_s)), el("span", {}, text))));
    while (list.childElementCount > MAX_SHOWN) list.firstElementChild.remove();
    if (isAtEnd || fresh) scrolled.scrollTop = scrolled.scrollHeight;
  };
  let last = 0;
  feed.on(["log"], ({ log }, fresh) => {
    if (fresh) last = 0;
    const entries = log.filter((entry) => entry.n > last);
    last = log.at(-1)?.n ?? last;
    for (const [name, [, isShown]] of Object.entries(LISTS)) append(name, entries.filter(isShown), fresh);
    const count = lists.orders.childElementCount;
    setText(tabs.orders, count ? `Orders (${count})` : "Orders");
  });
}
