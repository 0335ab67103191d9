"use strict";
// Draws every figure of the page for the chosen step of the ladder, in the colours of the reader's system.
(() => {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const form = document.getElementById("steps");
  const PAPER_WIDTH = 690; // px of a portrait page between its margins
  let printing = false;

  const chosen = () => (form ? Number(new FormData(form).get("step")) : 0);

  function draw() {
    const theme = dark.matches && !printing ? "dark" : "light";
    const step = chosen();
    const drawn = Object.entries(figures).map(([name, themes]) => {
      const perStep = themes[theme];
      const figure = perStep[Math.min(step, perStep.length - 1)];
      const layout = printing ? { ...figure.layout, width: PAPER_WIDTH } : figure.layout;
      return Plotly.react(`plot-${name}`, figure.data, layout, {
        responsive: true,
        displaylogo: false,
        modeBarButtons: [["toImage"], ["zoom2d", "pan2d", "resetScale2d"]],
        toImageButtonOptions: { format: "svg", filename: name },
      });
    });
    for (const part of document.querySelectorAll("[data-step]")) {
      part.hidden = Number(part.dataset.step) !== step;
    }
    return Promise.all(drawn).then(() => { document.documentElement.dataset.drawn = `${theme} ${step}`; });
  }

  if (form) form.addEventListener("change", draw);
  dark.addEventListener("change", draw);
  window.addEventListener("beforeprint", () => { printing = true; draw(); });
  window.addEventListener("afterprint", () => { printing = false; draw(); });
  draw();
})();
