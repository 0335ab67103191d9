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

// Effects that do not help these data are folded away until they are asked for.
document.addEventListener("click", ({ target }) => {
  if (target.id !== "unfold") return;
  const all = document.getElementById("effects-box").classList.toggle("all");
  target.setAttribute("aria-pressed", all);
});

// A symbol goes into the formula where the cursor is; React hears of it as if it had been typed.
document.addEventListener("click", ({ target }) => {
  const symbol = target.dataset?.symbol;
  const box = symbol && document.getElementById("formula");
  if (!box) return;
  const [from, to] = [box.selectionStart ?? box.value.length, box.selectionEnd ?? box.value.length];
  const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set;
  set.call(box, box.value.slice(0, from) + symbol + box.value.slice(to));
  box.dispatchEvent(new Event("input", { bubbles: true }));
  box.focus();
  box.setSelectionRange(from + symbol.length, from + symbol.length);
});

// The library's sliders have no names of their own: each is called what stands above it.
new MutationObserver(() => {
  for (const box of document.querySelectorAll(".slider")) {
    const name = box.querySelector("label").innerText;
    for (const part of box.querySelectorAll("[role=slider]:not([aria-label]), input:not([aria-label])")) {
      part.setAttribute("aria-label", name);
    }
  }
}).observe(document.documentElement, { childList: true, subtree: true });

// Sliders are made anew with every step: the one that had the focus has it again.
let slid = null;
document.addEventListener("pointerdown", () => { slid = null; }, true);
document.addEventListener("focusin", ({ target }) => { slid = target.closest(".slider [id]")?.id ?? null; });
new MutationObserver(() => {
  if (slid === null || document.activeElement !== document.body) return;
  document.getElementById(slid)?.querySelector("[role=slider]")?.focus();
}).observe(document.documentElement, { childList: true, subtree: true });

// The trials of a point lie below the figure: whoever clicks it is led there, once they have come.
let clicked = false;
document.addEventListener("pointerup", ({ target }) => { clicked = target.closest("#figure .js-plotly-plot") !== null; }, true);
new MutationObserver((changes) => {
  const trials = document.getElementById("trials");
  if (!clicked || !changes.some(({ target, addedNodes }) => addedNodes.length && trials?.contains(target))) return;
  clicked = false;
  trials.scrollIntoView({ block: "start" });
}).observe(document.documentElement, { childList: true, subtree: true });

// Formulas come as MathML in an attribute.
new MutationObserver(() => {
  for (const place of document.querySelectorAll("[data-mathml]")) {
    if (place.shown === place.dataset.mathml) continue;
    place.shown = place.innerHTML = place.dataset.mathml;
  }
}).observe(document.documentElement, { childList: true, subtree: true, attributeFilter: ["data-mathml"] });
