// Sends the token once; the server keeps it in a cookie that scripts cannot read.

const form = document.querySelector("form");
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const reply = await fetch("/login", {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ token: document.getElementById("token").value }),
  });
  if (reply.ok) location.assign("/");
  else form.querySelector(".problem").textContent = (await reply.json()).error;
});
