"""The page's own script: draws the charts one after the other, in the colours of the page, and keeps time axes together."""

__all__ = ["SCRIPT"]

SCRIPT = """
(function () {
  "use strict";
  const PRINT_WIDTH = 670;
  const charts = Array.from(document.querySelectorAll("figure[data-chart]"));
  const ink = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  // Grid and text take the colours of the page; printed, those of paper.
  function colours(layout, onPaper) {
    const soft = onPaper ? "#333" : ink("--soft"), rule = onPaper ? "#ddd" : ink("--rule"), change = { "font.color": soft };
    for (const key of Object.keys(layout)) {
      if (!/^[xy]axis/.test(key)) continue;
      change[key + ".gridcolor"] = rule; change[key + ".tickcolor"] = rule; change[key + ".zerolinecolor"] = soft;
    }
    change["modebar.bgcolor"] = "rgba(0,0,0,0)"; change["modebar.color"] = soft; change["modebar.activecolor"] = ink("--accent");
    change["hoverlabel.bgcolor"] = onPaper ? "#fff" : ink("--paper");
    change["hoverlabel.font.color"] = onPaper ? "#000" : ink("--ink");
    return change;
  }

  // A zoom in time on one chart of a recording moves the others along.
  let following = false;
  function follow(figure, event) {
    if (following || !figure.dataset.group) return;
    const from = event["xaxis.range[0]"], to = event["xaxis.range[1]"];
    const moved = from !== undefined && to !== undefined;
    if (!moved && !event["xaxis.autorange"]) return;
    const change = moved ? { "xaxis.range": [from, to] } : { "xaxis.autorange": true };
    following = true;
    const others = charts.filter(f => f !== figure && f.dataset.group === figure.dataset.group && f.drawn);
    Promise.all(others.map(f => Plotly.relayout(f.drawn, change))).finally(() => { following = false; });
  }

  function draw(figure) {
    const spec = JSON.parse(figure.querySelector("script").textContent), target = figure.querySelector(".plot");
    const options = { responsive: true, displayModeBar: "hover", displaylogo: false,
      modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
      toImageButtonOptions: { format: "svg", filename: figure.dataset.chart }, showSendToCloud: false };
    figure.drawn = target;
    return Plotly.newPlot(target, spec.data, spec.layout, options)
      .then(() => Plotly.relayout(target, colours(spec.layout, false)))
      .then(() => { target.on("plotly_relayout", event => follow(figure, event)); });
  }

  function restyle(onPaper) {
    for (const figure of charts) {
      if (!figure.drawn) continue;
      const change = colours(figure.drawn.layout, onPaper);
      if (onPaper) { change.width = PRINT_WIDTH; change.autosize = false; } else { change.width = null; change.autosize = true; }
      Plotly.relayout(figure.drawn, change);
    }
  }

  let queue = Promise.resolve();
  for (const figure of charts) queue = queue.then(() => new Promise(done => setTimeout(done, 0))).then(() => draw(figure));
  queue.then(() => { document.documentElement.dataset.drawn = "yes"; });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => restyle(false));
  addEventListener("beforeprint", () => restyle(true));
  addEventListener("afterprint", () => restyle(false));
})();
"""
