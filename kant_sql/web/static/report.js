// Draws the timeline of a report. Without it, the table of the same is open.
"use strict";
// In pixels: what A4 and letter have between their margins.
const PAPER = 680;
(() => {
  const text = document.getElementById("figure").textContent;
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const chart = document.getElementById("chart");
  const options = {responsive: true, displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d"]};

  function draw(isDark, width) {
    const {figure, theme} = JSON.parse(text);
    const drawn = isDark ? JSON.parse(recoloured(JSON.stringify(figure), theme)) : figure;
    Plotly.react(chart, drawn.data, {...drawn.layout, width, autosize: !width}, options);
  }

  function recoloured(json, theme) {
    for (const [light, other] of theme) { json = json.replaceAll(JSON.stringify(light), JSON.stringify(other)); }
    return json;
  }

  chart.hidden = false;
  draw(dark.matches);
  document.getElementById("periods").open = false;
  dark.addEventListener("change", () => draw(dark.matches));
  // Paper is light and narrow, and what is closed is not printed.
  addEventListener("beforeprint", () => {
    draw(false, PAPER);
    for (const each of document.querySelectorAll("details")) { each.open = true; }
  });
  addEventListener("afterprint", () => draw(dark.matches));
})();
