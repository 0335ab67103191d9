"use strict";
// Draws every figure of the page for the chosen step of the ladder, in the colours of the reader's system.
(() => {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const slider = document.getElementById("rung");
  const rungs = [...document.querySelectorAll("[data-rung]")];
  const PAPER_WIDTH = 940; // px between the margins of a portrait page, at the zoom of report.css
  const PRINT_HEIGHT = 0.9; // relative to the screen, so that two or three figures fit on a page
  let printing = false;

  const chosen = () => (slider ? Number(slider.value) : 0);

  function draw() {
    const theme = dark.matches && !printing ? "dark" : "light";
    const step = chosen();
    const drawn = Object.entries(figures).map(([name, themes]) => {
      const perStep = themes[theme];
      const figure = perStep[Math.min(step, perStep.length - 1)];
      // A copy: Plotly writes into the layout that it is given, and a resize deletes the height from it.
      const layout = { ...figure.layout };
      if (printing) Object.assign(layout, { width: PAPER_WIDTH, height: PRINT_HEIGHT * layout.height });
      return Plotly.react(`plot-${name}`, figure.data, layout, {
        responsive: true,
        displaylogo: false,
        modeBarButtons: [["zoom2d", "pan2d", "resetScale2d"]],
      });
    });
    for (const part of document.querySelectorAll("[data-step]")) {
      part.hidden = Number(part.dataset.step) !== step;
    }
    for (const rung of rungs) rung.toggleAttribute("data-chosen", Number(rung.dataset.rung) === step);
    if (slider) slider.setAttribute("aria-valuetext", rungs[step].innerText.replace(/\s+/g, " "));
    return Promise.all(drawn).then(() => { document.documentElement.dataset.drawn = `${theme} ${step}`; });
  }

  function go(step) {
    slider.value = step;
    draw();
  }

  if (slider) slider.addEventListener("input", draw);
  for (const rung of rungs) rung.addEventListener("click", () => go(rung.dataset.rung));
  document.addEventListener("click", ({ target }) => {
    const { format, figure } = target.dataset ?? {};
    if (format) window.sandbotExport.save(document.getElementById(`plot-${figure}`), format, figure);
  });
  dark.addEventListener("change", draw);
  const folds = document.querySelectorAll(".why, #data details");
  function print(now) {
    printing = now;
    for (const folded of folds) folded.open = now; // print the reason and the data tables unfolded
    return draw();
  }

  window.addEventListener("beforeprint", () => print(true));
  window.addEventListener("afterprint", async () => {
    await print(false);
    document.querySelectorAll(".plot").forEach((plot) => Plotly.Plots.resize(plot)); // from the width of the paper
  });
  draw();
})();
