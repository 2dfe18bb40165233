// Draws the timeline of the window that the address names, and asks for another window when the
// reader zooms or moves: always for what is visible, never for more.
"use strict";
(() => {
  const chart = document.getElementById("chart");
  const form = document.getElementById("filter");
  complete();
  if (!chart) return;
  if (!window.Plotly) return chart.removeAttribute("aria-busy");
  const trouble = document.getElementById("trouble");
  const REST = 250, PAUSE = 1000, SHORTEST = 2;
  const CONFIG = { displayModeBar: false, responsive: true, doubleClick: false, showTips: false };
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const coarse = matchMedia("(pointer: coarse)");
  const paper = matchMedia("print");
  let asked = null, timer = 0, following = 0, isDrawn = false;

  const query = () => new URLSearchParams(location.search);
  // A time in full, as an axis and an address have it; a revision or `2 hours ago` is none.
  const parse = (text) =>
    /^\d{4}-\d\d-\d\d/.test(text) ? Date.parse(`${text.replace(" ", "T").slice(0, 23).replace("Z", "")}${/\d:\d/.test(text) ? "Z" : ""}`) : NaN;
  const write = (moment) => new Date(moment).toISOString();
  const range = () => chart.layout.xaxis.range.map(parse);

  async function ask(address, signal) {
    const answer = await fetch(address, { signal });
    if (!answer.ok) {
      const said = await answer.json().catch(() => ({}));
      throw new Error(said.error || `the server answers ${answer.status}`);
    }
    return answer;
  }

  // The figure, and the part of the page that says the same as text.
  async function load({ text = true } = {}) {
    if (asked) asked.abort();
    asked = new AbortController();
    const { signal } = asked;
    chart.setAttribute("aria-busy", "true");
    const wanted = query();
    const page = text ? ask(`${location.pathname}?${wanted}`, signal) : null;
    const figure = new URL(chart.dataset.figure, location.href);
    for (const [name, value] of wanted) figure.searchParams.append(name, value);
    figure.searchParams.set("slices", Math.max(100, Math.min(2000, Math.round(chart.clientWidth))));
    if (dark.matches) figure.searchParams.set("dark", "true");
    try {
      const spec = await (await ask(figure, signal)).json();
      await draw(spec, wanted);
      if (page) show(await (await page).text());
      trouble.hidden = true;
      chart.removeAttribute("aria-busy");
    } catch (error) {
      if (error.name === "AbortError") return;
      trouble.textContent = error.message;
      trouble.hidden = false;
      chart.removeAttribute("aria-busy");
    }
    if (page) page.catch(() => {});
  }

  async function draw({ data, layout }, wanted) {
    const [since, until] = [wanted.get("since"), wanted.get("until")].map((each) => parse(each || ""));
    // What the reader has chosen stays as it is; the figure leaves some room beside it.
    if (since < until) layout.xaxis.range = [write(since), write(until)].map((each) => each.slice(0, -1));
    layout.xaxis.autorange = false;
    layout.dragmode = coarse.matches ? false : "zoom";
    await Plotly.react(chart, data, layout, CONFIG);
    if (isDrawn) return;
    isDrawn = true;
    chart.on("plotly_relayout", (change) => {
      if (Object.keys(change).some((name) => name.startsWith("xaxis.range"))) rest();
    });
    chart.on("plotly_doubleclick", () => move("out"));
    chart.on("plotly_click", ({ points }) => {
      const [{ customdata, data: trace, y }] = points;
      const target = trace.meta?.targets ? trace.meta.targets[y] : customdata;
      if (typeof target === "string" && target.startsWith("/")) location.assign(target);
    });
  }

  function show(html) {
    const fresh = new DOMParser().parseFromString(html, "text/html").getElementById("shown");
    const part = document.getElementById("shown");
    if (!fresh) return;
    part.toggleAttribute("data-live", fresh.hasAttribute("data-live"));
    part.replaceChildren(...fresh.childNodes);
  }

  // Waits until the reader rests, then makes the window an address of its own.
  function rest() {
    clearTimeout(timer);
    timer = setTimeout(() => go(...range()), REST);
  }

  function go(since, until) {
    const wanted = query();
    for (const [name, value] of [["since", since], ["until", until]]) {
      if (value === null) wanted.delete(name);
      else wanted.set(name, write(value));
      form.elements[name].value = wanted.get(name) || "";
    }
    const address = `${location.pathname}?${wanted}`;
    if (address !== location.pathname + location.search) history.pushState(null, "", address);
    load();
  }

  function move(how, share = 0.5) {
    clearTimeout(timer);
    if (how === "all") return go(null, null);
    let [since, until] = range();
    const length = until - since;
    const factor = { in: 0.5, out: 2 }[how];
    if (factor) {
      const middle = since + length * share, wide = Math.max(length * factor, SHORTEST);
      since = middle - wide * share;
      until = since + wide;
    } else {
      const step = (how === "earlier" ? -1 : 1) * length * 0.25;
      since += step;
      until += step;
    }
    if (!(since > -6e13 && until < 2.5e14)) return;
    Plotly.relayout(chart, { "xaxis.range": [write(since), write(until)].map((each) => each.slice(0, -1)) });
  }

  for (const button of document.querySelectorAll("#tools [data-move]"))
    button.addEventListener("click", () => move(button.dataset.move));
  const KEYS = { ArrowLeft: "earlier", ArrowRight: "later", "+": "in", "=": "in", "-": "out", 0: "all" };
  chart.addEventListener("keydown", (event) => {
    const how = KEYS[event.key];
    if (!how || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    move(how);
  });
  chart.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.shiftKey) return;
    event.preventDefault();
    const axis = chart._fullLayout?.xaxis, box = chart.getBoundingClientRect();
    const share = axis ? (event.clientX - box.left - axis._offset) / axis._length : 0.5;
    move(event.deltaY + event.deltaX > 0 ? "out" : "in", Math.min(Math.max(share, 0), 1));
  }, { passive: false });

  addEventListener("popstate", () => {
    const wanted = query();
    for (const field of form.elements) if (field.name && field.type !== "hidden") field.value = wanted.get(field.name) || "";
    load();
  });
  dark.addEventListener("change", () => load({ text: false }));
  // A window without an end follows what happens; the text is brought up to date with the page.
  document.addEventListener("kant-sql:revision", () => {
    if (query().get("until") || following) return;
    following = setTimeout(() => {
      following = 0;
      load({ text: false });
    }, PAUSE);
  });
  // On paper it is black on white, and as wide as a sheet.
  const print = (isPrinted) => {
    if (!isDrawn) return;
    if (!isPrinted) return Plotly.relayout(chart, { width: null, autosize: true }).then(() => load({ text: false }));
    const lines = chart.data.flatMap((trace, n) => (trace.mode?.startsWith("lines") ? [n] : []));
    if (lines.length) Plotly.restyle(chart, { "line.color": "#444" }, lines);
    const annotations = chart.layout.annotations.map((one) => ({ ...one, font: { ...one.font, color: "#000" } }));
    Plotly.relayout(chart, { width: Math.min(chart.clientWidth, 690), "font.color": "#000", annotations });
  };
  paper.addEventListener("change", ({ matches }) => print(matches));
  load({ text: false });

  // Names of predicates, functions and objects as they are typed.
  function complete() {
    if (!form) return;
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
  }
})();
