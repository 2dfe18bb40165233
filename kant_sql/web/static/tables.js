// Says the local time and how long ago it was beside each time, and sorts a table by a column.
"use strict";
(() => {
  const UNITS = [["year", 31557600], ["month", 2629800], ["day", 86400], ["hour", 3600], ["minute", 60], ["second", 1]];
  const ago = new Intl.RelativeTimeFormat("en", { numeric: "auto", style: "narrow" });
  const local = new Intl.DateTimeFormat("sv", { dateStyle: "short", timeStyle: "medium" });

  function near(moment) {
    const seconds = (moment - Date.now()) / 1000;
    const [unit, length] = UNITS.find(([, size]) => Math.abs(seconds) >= size) ?? UNITS.at(-1);
    const here = local.format(moment);
    const [day, clock] = here.split(" ");
    const same = moment.toISOString().startsWith(day);
    return `${same ? clock : here} local, ${ago.format(Math.round(seconds / length), unit)}`;
  }

  // Also for the parts of a page that are brought up to date, before they are compared.
  window.kantTimes = (root) => {
    for (const time of root.querySelectorAll("time[datetime]")) {
      const moment = new Date(time.dateTime);
      if (!Number.isNaN(moment.getTime())) time.dataset.near = near(moment);
    }
    for (const head of root.querySelectorAll("table:not(.fixed) thead th[scope=col]")) {
      if (!head.textContent.trim() || head.closest("table").tBodies[0].rows.length < 2) continue;
      head.classList.add("sortable");
      head.tabIndex = 0;
      head.title = "Sort the rows that are shown";
    }
  };
  window.kantTimes(document);

  const key = (row, place) => {
    const cell = row.cells[place];
    return (cell.querySelector("time")?.dateTime ?? cell.textContent).trim();
  };
  const order = new Intl.Collator("en", { numeric: true });

  function sort(head) {
    const place = head.cellIndex, table = head.closest("table");
    const isDown = head.getAttribute("aria-sort") === "ascending";
    for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", isDown ? "descending" : "ascending");
    const rows = [...table.tBodies[0].rows];
    rows.sort((one, other) => order.compare(key(one, place), key(other, place)) * (isDown ? -1 : 1));
    table.tBodies[0].append(...rows);
  }

  const chosen = ({ target }) => target.closest?.("th.sortable");
  document.addEventListener("click", (event) => chosen(event) && sort(chosen(event)));
  document.addEventListener("keydown", (event) => {
    if (!chosen(event) || (event.key !== "Enter" && event.key !== " ")) return;
    event.preventDefault();
    sort(chosen(event));
  });
})();
