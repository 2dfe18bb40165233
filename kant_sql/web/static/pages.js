// A slider shows its revision while it is moved, and opens it when it rests.
"use strict";
for (const slider of document.querySelectorAll("input[type=range][data-revision]")) {
  const form = slider.form;
  const output = form.querySelector("output");
  const moved = "kant_sql slider";
  let waiting = 0;
  slider.addEventListener("input", () => {
    output.textContent = slider.value;
    clearTimeout(waiting);
  });
  slider.addEventListener("change", () => {
    clearTimeout(waiting);
    waiting = setTimeout(() => {
      sessionStorage.setItem(moved, "1");
      form.requestSubmit();
    }, 400);
  });
  if (sessionStorage.getItem(moved)) {
    sessionStorage.removeItem(moved);
    slider.focus({ preventScroll: true });
  }
}
// Fields that are left empty stay out of the address.
for (const form of document.querySelectorAll("form[method=get]")) {
  form.addEventListener("submit", () => {
    for (const field of form.elements) {
      if (field.name && field.value === "") field.disabled = true;
    }
  });
}
window.addEventListener("pageshow", () => {
  for (const field of document.querySelectorAll("form[method=get] :disabled")) field.disabled = false;
});
