// Events of the run, and orders with their answers, newest last.

import { el, setText } from "./dom.js";
import { duration } from "./format.js";

const MAX_SHOWN = 300;

export function showLog(root, feed) {
  const lists = { events: el("ol", { role: "tabpanel", tabindex: "0" }), orders: el("ol", { role: "tabpanel", tabindex: "0", hidden: true }) };
  const tabs = {};
  const choose = (chosen) => {
    for (const name of Object.keys(lists)) {
      lists[name].hidden = name !== chosen;
      tabs[name].setAttribute("aria-selected", String(name === chosen));
    }
    lists[chosen].scrollTop = lists[chosen].scrollHeight;
  };
  for (const [name, title] of [["events", "Events"], ["orders", "Orders"]]) {
    tabs[name] = el("button", { role: "tab", onclick: () => choose(name) }, title);
  }
  root.append(el("div", { class: "tabs", role: "tablist" }, ...Object.values(tabs)), ...Object.values(lists));
  choose("events");

  const append = (list, entries, fresh) => {
    const atEnd = list.scrollHeight - list.scrollTop - list.clientHeight < 30;
    if (fresh) list.replaceChildren();
    list.append(...entries.map(({ t_s, level, text }) =>
      el("li", { class: level }, el("time", {}, duration(t_s)), el("span", {}, text))));
    while (list.childElementCount > MAX_SHOWN) list.firstElementChild.remove();
    if (atEnd || fresh) list.scrollTop = list.scrollHeight;
  };

  let lastEvent = 0;
  feed.on(["log"], ({ log }, fresh) => {
    if (fresh) lastEvent = 0;
    append(lists.events, log.filter((entry) => entry.n > lastEvent && entry.kind !== "OrderAnswer"), fresh);
    lastEvent = log.at(-1)?.n ?? lastEvent;
  });
  let lastOrder = 0;
  feed.on(["log"], ({ log }, fresh) => {
    if (fresh) lastOrder = 0;
    append(lists.orders, log.filter((entry) => entry.n > lastOrder && entry.kind === "OrderAnswer"), fresh);
    lastOrder = log.at(-1)?.n ?? lastOrder;
    setText(tabs.orders, `Orders${lists.orders.childElementCount ? ` (${lists.orders.childElementCount})` : ""}`);
  });
}
