// Completes names in the box of the condition, as the ARIA practices describe it for a combobox; a
// box of several lines may not have that role itself.
"use strict";
(() => {
  const box = document.getElementById("condition");
  if (!box) return;
  const list = document.createElement("ul");
  list.className = "options";
  list.id = "condition-options";
  list.setAttribute("role", "listbox");
  list.setAttribute("aria-label", "Names");
  list.hidden = true;
  box.after(list);
  for (const [name, value] of Object.entries({
    "aria-autocomplete": "list",
    "aria-haspopup": "listbox",
    "aria-controls": list.id,
  })) box.setAttribute(name, value);

  const NAME = /[^\s()?=<>*/+;"'`,]+$/;
  const WAIT = 120;
  let timer = 0;
  let asked = null;
  let chosen = -1;

  const word = () => {
    const before = box.value.slice(0, box.selectionEnd);
    const found = NAME.exec(before);
    // A variable, a keyword or a number is not the name of an element.
    if (!found || /[?:\d.-]/.test(found[0][0]) || before[found.index - 1] === "?") return "";
    return found[0];
  };

  // What was asked is answered too late once the list is closed: it would open again.
  const close = () => {
    clearTimeout(timer);
    if (asked) asked.abort();
    list.hidden = true;
    chosen = -1;
    box.removeAttribute("aria-activedescendant");
  };

  const choose = (index) => {
    const options = list.children;
    if (chosen >= 0) options[chosen].setAttribute("aria-selected", "false");
    chosen = (index + options.length) % options.length;
    options[chosen].setAttribute("aria-selected", "true");
    options[chosen].scrollIntoView({ block: "nearest" });
    box.setAttribute("aria-activedescendant", options[chosen].id);
  };

  const take = (name) => {
    const end = box.selectionEnd;
    const begin = end - word().length;
    box.setRangeText(name, begin, end, "end");
    close();
    box.focus();
  };

  const show = (names) => {
    const kept = list.children[chosen]?.dataset.key;
    list.replaceChildren();
    names.forEach((one, index) => {
      const option = document.createElement("li");
      option.id = `condition-option-${index}`;
      option.setAttribute("role", "option");
      option.setAttribute("aria-selected", "false");
      const text = document.createElement("code");
      text.textContent = one.text;
      const kind = document.createElement("span");
      kind.className = "kind";
      kind.textContent = one.kind;
      option.append(text, kind);
      option.addEventListener("mousedown", (event) => {
        event.preventDefault();
        take(one.name);
      });
      option.dataset.name = one.name;
      option.dataset.key = `${one.kind} ${one.name}`;
      list.append(option);
    });
    chosen = -1;
    box.removeAttribute("aria-activedescendant");
    list.hidden = names.length === 0;
    // An answer may come between the choice of a name and the key that takes it.
    const again = [...list.children].findIndex((option) => option.dataset.key === kept);
    if (again >= 0) choose(again);
  };

  const complete = async () => {
    const beginning = word();
    if (!beginning) return close();
    if (asked) asked.abort();
    asked = new AbortController();
    const address = new URL(box.dataset.names, location.href);
    address.searchParams.set("beginning", beginning);
    const at = box.form.elements.at.value.trim();
    if (at) address.searchParams.set("at", at);
    try {
      const answer = await fetch(address, { signal: asked.signal });
      if (!answer.ok) return close();
      const { names } = await answer.json();
      const isDone = names.length === 1 && names[0].name === beginning;
      if (word() === beginning) show(isDone ? [] : names);
    } catch (error) {
      if (error.name !== "AbortError") close();
    }
  };

  box.addEventListener("input", () => {
    clearTimeout(timer);
    timer = setTimeout(complete, WAIT);
  });
  box.addEventListener("blur", close);
  box.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) return box.form.requestSubmit();
    if (list.hidden) return;
    if (event.key === "ArrowDown") choose(chosen + 1);
    else if (event.key === "ArrowUp") choose(chosen < 0 ? -1 : chosen - 1);
    else if (event.key === "Escape") close();
    else if ((event.key === "Enter" || event.key === "Tab") && chosen >= 0) take(list.children[chosen].dataset.name);
    else return;
    event.preventDefault();
  });
})();
