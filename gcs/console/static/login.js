// Login page: sends the token once; the server keeps it in a cookie that scripts cannot read.

const form = /** @type {HTMLFormElement} */ (document.querySelector("form"));
const token = /** @type {HTMLInputElement} */ (document.querySelector("#token"));
const problem = /** @type {HTMLElement} */ (document.querySelector(".problem"));

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const reply = await fetch("/login", {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ token: token.value }),
  });
  if (reply.ok) location.assign("/");
  else problem.textContent = (await reply.json()).error;
});
