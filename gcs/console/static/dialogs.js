// Questions before dangerous orders, and other dialogs.

import { el } from "./dom.js";

/**
 * @param {string} title
 * @param {HTMLElement[]} content
 * @param {HTMLElement[]} actions
 */
export function openDialog(title, content, actions) {
  const dialog = el(
    "dialog",
    { "aria-label": title },
    el("h3", {}, title),
    ...content,
    el("div", { class: "actions" }, ...actions),
  );
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
  return dialog;
}

/**
 * Resolve to true only if the user presses the button that says what will be done.
 *
 * @param {string} title
 * @param {string} text
 * @param {string} verb
 * @returns {Promise<boolean>}
 */
export function ask(title, text, verb) {
  return new Promise((resolve) => {
    let isAgreed = false;
    const agree = () => {
      isAgreed = true;
      dialog.close();
    };
    const cancel = el("button", { autofocus: true, onclick: () => dialog.close() }, "Cancel");
    const act = el("button", { class: "danger", onclick: agree }, verb);
    const dialog = openDialog(title, [el("p", {}, text)], [cancel, act]);
    dialog.addEventListener("close", () => resolve(isAgreed));
  });
}

/** @param {[key: string, text: string][]} keys */
export function showKeys(keys) {
  const rows = keys.flatMap(([key, text]) => [el("dt", {}, el("kbd", {}, key)), el("dd", {}, text)]);
  const close = el("button", { autofocus: true, onclick: () => dialog.close() }, "Close");
  const dialog = openDialog("Keys", [el("dl", {}, ...rows)], [close]);
}
