"use strict";
// What only the browser knows: its colours and its history.
window.dash_clientside = Object.assign({}, window.dash_clientside, {
  explore: {
    theme: () => (window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"),
    undo: () => { window.history.back(); return Date.now(); },
  },
});

document.addEventListener("click", ({ target }) => {
  const { format, figure } = target.dataset ?? {};
  const plot = figure && document.querySelector(`[id="${figure}"] .js-plotly-plot`);
  if (plot) window.sandbotExport.save(plot, format, figure);
});
