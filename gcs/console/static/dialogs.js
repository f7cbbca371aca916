// Questions before dangerous orders, and other dialogs.

import { el } from "./dom.js";

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

// Resolves to true only if the user presses the button that says what will be done.
export function ask(title, text, verb) {
  return new Promise((resolve) => {
    let agreed = false;
    const cancel = el("button", { autofocus: true, onclick: () => dialog.close() }, "Cancel");
    const act = el(
      "button",
      {
        class: "danger",
        onclick: () => {
          agreed = true;
          dialog.close();
        },
      },
      verb,
    );
    const dialog = openDialog(title, [el("p", {}, text)], [cancel, act]);
    dialog.addEventListener("close", () => resolve(agreed));
  });
}

export function showKeys(keys) {
  const rows = keys.flatMap(([key, text]) => [el("dt", {}, el("kbd", {}, key)), el("dd", {}, text)]);
  const dialog = openDialog(
    "Keys",
    [el("dl", {}, ...rows)],
    [el("button", { autofocus: true, onclick: () => dialog.close() }, "Close")],
  );
}
