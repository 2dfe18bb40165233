// Draws the timeline of a report. Without it, the table of the same is open.
"use strict";
(() => {
  // In pixels: what A4 and letter have between their margins.
  const PAPER = 680;
  const CONFIG = { displayModeBar: false, responsive: true, showTips: false };
  const text = document.getElementById("figure").textContent;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const chart = document.getElementById("chart"), tools = document.getElementById("tools");

  function draw(isDark, width) {
    const { figure, theme } = JSON.parse(text);
    const drawn = isDark ? JSON.parse(recoloured(JSON.stringify(figure), theme)) : figure;
    // What the reader has chosen stays.
    if (chart.layout) drawn.layout.xaxis.range = chart.layout.xaxis.range;
    Plotly.react(chart, drawn.data, { ...drawn.layout, width, autosize: !width }, CONFIG);
  }

  function recoloured(json, theme) {
    for (const [light, other] of theme) json = json.replaceAll(JSON.stringify(light), JSON.stringify(other));
    return json;
  }

  const parse = (moment) => Date.parse(`${String(moment).replace(" ", "T").slice(0, 23)}${/\d:\d/.test(moment) ? "Z" : ""}`);
  const write = (moment) => new Date(moment).toISOString().slice(0, -1);
  const show = (range) => Plotly.relayout(chart, { "xaxis.range": range });

  function move(how) {
    if (how === "all") return show(JSON.parse(text).figure.layout.xaxis.range);
    const [since, until] = chart.layout.xaxis.range.map(parse), length = until - since;
    const [from, to] = { earlier: [-0.25, -0.25], later: [0.25, 0.25], in: [0.25, -0.25], out: [-0.5, 0.5] }[how];
    const range = [since + from * length, until + to * length];
    if (range[0] > -6e13 && range[1] < 2.5e14 && range[1] - range[0] > 2) show(range.map(write));
  }

  chart.hidden = tools.hidden = false;
  draw(dark.matches);
  document.getElementById("periods").open = false;
  for (const button of tools.querySelectorAll("[data-move]"))
    button.addEventListener("click", () => move(button.dataset.move));
  dark.addEventListener("change", () => draw(dark.matches));
  // Paper is light and narrow, and what is closed is not printed.
  addEventListener("beforeprint", () => {
    draw(false, PAPER);
    for (const each of document.querySelectorAll("details")) each.open = true;
  });
  addEventListener("afterprint", () => draw(dark.matches));
})();
