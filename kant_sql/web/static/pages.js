// A slider shows its revision while it is moved, and opens it when it rests.
"use strict";
(() => {
  const SLIDER = "input[type=range][data-revision]", MOVED = "kant_sql slider", REST = 400;
  let waiting = 0;
  document.addEventListener("input", ({ target }) => {
    if (!target.matches(SLIDER)) return;
    clearTimeout(waiting);
    target.form.querySelector("output").textContent = target.value;
  });
  document.addEventListener("change", ({ target }) => {
    if (!target.matches(SLIDER)) return;
    clearTimeout(waiting);
    waiting = setTimeout(() => {
      sessionStorage.setItem(MOVED, target.id);
      target.form.requestSubmit();
    }, REST);
  });
  const moved = sessionStorage.getItem(MOVED);
  sessionStorage.removeItem(MOVED);
  if (moved) document.getElementById(moved)?.focus({ preventScroll: true });

  // Fields that are left empty stay out of the address.
  document.addEventListener("submit", ({ target }) => {
    if (target.method !== "get") return;
    for (const field of target.elements) if (field.name && field.value === "") field.disabled = true;
  });
  addEventListener("pageshow", () => {
    for (const field of document.querySelectorAll("form[method=get] :disabled")) field.disabled = false;
  });
})();
