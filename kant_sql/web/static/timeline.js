// Keys that lead to other windows of the timeline, and names as they are typed.
"use strict";
(() => {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, select, .scroll")) return;
    const key = event.key === "=" ? "+" : event.key;
    const link = [...document.querySelectorAll("a[data-key]")].find((each) => each.dataset.key === key);
    if (!link) return;
    event.preventDefault();
    link.click();
  });

  const form = document.getElementById("filter");
  let typing = null;
  for (const field of form.querySelectorAll("[data-kinds]")) {
    const kinds = field.dataset.kinds.split(" "), list = document.getElementById(field.getAttribute("list"));
    field.addEventListener("input", async () => {
      if (typing) typing.abort();
      typing = new AbortController();
      const address = new URL(form.dataset.names, location.href);
      address.searchParams.set("beginning", field.value);
      address.searchParams.set("limit", "40");
      try {
        const answer = await fetch(address, { signal: typing.signal });
        if (!answer.ok) return;
        const { names } = await answer.json();
        const options = names.filter((one) => kinds.includes(one.kind));
        list.replaceChildren(...options.map((one) => new Option(one.text, one.name)));
      } catch {
        // Without the names, the reader types them.
      }
    });
  }
})();
