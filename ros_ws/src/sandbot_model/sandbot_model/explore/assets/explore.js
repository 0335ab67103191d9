"use strict";
// What only the browser knows: its colours and its history.
window.dash_clientside = Object.assign({}, window.dash_clientside, {
  explore: {
    theme: () => (window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"),
    undo: () => { window.history.back(); return Date.now(); },
    settle,
  },
});

// Controls stand where the address says once what is shown is what the address asks for. Not before: an answer may come
// late. And not while a control has a value that is not told yet: that one is asked for (see on_control).
function settle(shown, reported, search) {
  const { states } = window.dash_clientside.callback_context;
  const values = Object.fromEntries(Object.keys(told).map((name) => [name, states[`${name}.value`]]));
  const differ = (one, other) => Object.keys(one).filter((name) => !same(one[name], other[name]));
  const set = window.dash_clientside.set_props;
  if (differ(values, told).length) { set("recheck", { data: Date.now() }); return; }
  if (!shown || shown.search !== (search ?? "")) return;
  const astray = differ(shown.controls, values);
  for (const name of astray) set(name, { value: shown.controls[name] });
  // Last: a control whose value was not told counts as used.
  if (astray.length) set("reported", { data: shown.controls });
}

function same(one, other) { return JSON.stringify(one ?? null) === JSON.stringify(other ?? null); }

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

// The library gives its lists of native inputs the roles of a list box, which they are not; a reader hears the inputs.
const LISTS = { model: "Base model", effects: "Effects", view: "View", observable: "Observable" };
new MutationObserver(() => {
  for (const [name, words] of Object.entries(LISTS)) {
    const list = document.getElementById(name);
    if (list?.getAttribute("role") !== "listbox") continue;
    list.setAttribute("role", name === "effects" ? "group" : "radiogroup");
    list.setAttribute("aria-label", words);
  }
  for (const label of document.querySelectorAll("label[role=option], label[aria-selected]")) {
    label.removeAttribute("role");
    label.removeAttribute("aria-selected");
  }
  // What is hidden from readers passes the keyboard on to the button beside it, which can have both itself.
  for (const one of document.querySelectorAll(".dash-dropdown-focus-target[tabindex='0']")) {
    const button = one.parentElement.querySelector(".dash-dropdown");
    if (!button) continue;
    button.tabIndex = 0;
    one.tabIndex = -1;
  }
}).observe(document.documentElement, {
  childList: true, subtree: true, attributeFilter: ["role", "aria-selected", "tabindex"],
});

// Sliders are made anew with every step: the one that had the focus has it again.
let slid = null;
document.addEventListener("pointerdown", () => { slid = null; }, true);
document.addEventListener("focusin", ({ target }) => { slid = target.closest(".slider [id]")?.id ?? null; });
new MutationObserver(() => {
  if (slid === null || document.activeElement !== document.body) return;
  document.getElementById(slid)?.querySelector("[role=slider]")?.focus();
}).observe(document.documentElement, { childList: true, subtree: true });

// The trials of a point lie below the figure: whoever clicks it is led there once they have come, and kept there while
// the figures above are drawn anew, unless he moves himself.
const SETTLED_MS = 2000;
let leading = 0;
document.addEventListener("pointerup", ({ target }) => {
  leading = target.closest("#figure .js-plotly-plot") ? Infinity : 0;
}, true);
for (const moves of ["wheel", "touchmove", "keydown", "pointerdown"]) {
  document.addEventListener(moves, () => { leading = 0; }, { capture: true, passive: true });
}
new MutationObserver((changes) => {
  const trials = document.getElementById("trials");
  const came = changes.some(({ target, addedNodes }) => addedNodes.length && trials?.contains(target));
  if (came && leading) leading = performance.now() + SETTLED_MS;
  if (leading !== Infinity && performance.now() < leading) trials?.scrollIntoView({ block: "start" });
}).observe(document.documentElement, { childList: true, subtree: true });

// What does not change by itself comes as HTML in an attribute (still.py), and formulas as MathML.
new MutationObserver(() => {
  for (const place of document.querySelectorAll("[data-html]")) {
    if (place.shown === place.dataset.html) continue;
    place.shown = place.innerHTML = place.dataset.html;
  }
}).observe(document.documentElement, { childList: true, subtree: true, attributeFilter: ["data-html"] });

// A table that is dropped on the page is set beside the data.
document.addEventListener("dragover", (event) => event.preventDefault());
document.addEventListener("drop", async (event) => {
  event.preventDefault();
  const [file] = event.dataTransfer.files;
  if (!file) return;
  const answer = await fetch(`/drop?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
  if (answer.ok) { location.reload(); return; }
  document.getElementById("message").textContent = await answer.text();
});

// A campaign that grows: the page is made anew with its state, but not under the hands of somebody who types.
(async function follow(before) {
  const { version, follows } = await fetch("/live").then((answer) => answer.json()).catch(() => ({ version: before }));
  const typing = document.activeElement?.matches("input[type=text], input[type=search]");
  if (before !== undefined && version !== before && !typing) { location.reload(); return; }
  if (follows || before !== undefined) setTimeout(follow, 2000, before ?? version);
})();
