"use strict";
// Clientside callbacks: the colour scheme, the history, and the state of the controls.
window.dash_clientside = Object.assign({}, window.dash_clientside, {
  explore: {
    theme: () => (window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"),
    undo: () => { window.history.back(); return Date.now(); },
    settle,
  },
});

// Sets the controls to the state in the address once the page shown is that of the address (answers may come late) and
// all values of controls are reported to the server; otherwise these are reported first (see on_control).
function settle(shown, reported, search) {
  const { states } = window.dash_clientside.callback_context;
  const values = Object.fromEntries(Object.keys(reported).map((name) => [name, states[`${name}.value`]]));
  const differ = (first, second) => Object.keys(first).filter((name) => !same(first[name], second[name]));
  const set = window.dash_clientside.set_props;
  if (differ(values, reported).length) { set("recheck", { data: Date.now() }); return; }
  if (!shown || shown.search !== (search ?? "")) return;
  const outdated = differ(shown.controls, values);
  for (const name of outdated) set(name, { value: shown.controls[name] });
  // Last: a control whose value was not reported counts as used.
  if (outdated.length) set("reported", { data: shown.controls });
}

function same(first, second) { return JSON.stringify(first ?? null) === JSON.stringify(second ?? null); }

document.addEventListener("click", ({ target }) => {
  const { format, figure } = target.dataset ?? {};
  const plot = figure && document.querySelector(`[id="${figure}"] .js-plotly-plot`);
  if (plot) window.sandbotExport.save(plot, format, figure);
});

// Effects that do not help these data are folded away; "Show all effects" unfolds them.
document.addEventListener("click", ({ target }) => {
  if (target.id !== "unfold") return;
  const all = document.getElementById("effects-box").classList.toggle("all");
  target.setAttribute("aria-pressed", all);
});

// Inserts a symbol into the formula at the cursor, with the event by which React notices typing.
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

// Dash sliders have no accessible name: each gets the text of the label above it.
new MutationObserver(() => {
  for (const box of document.querySelectorAll(".slider")) {
    const name = box.querySelector("label").innerText;
    for (const part of box.querySelectorAll("[role=slider]:not([aria-label]), input:not([aria-label])")) {
      part.setAttribute("aria-label", name);
    }
  }
}).observe(document.documentElement, { childList: true, subtree: true });

// Dash gives its lists of native inputs the roles of a list box; screen readers need those of the inputs.
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
  // An element hidden from screen readers forwards keyboard focus to a button; the button takes the focus itself instead.
  for (const target of document.querySelectorAll(".dash-dropdown-focus-target[tabindex='0']")) {
    const button = target.parentElement.querySelector(".dash-dropdown");
    if (!button) continue;
    button.tabIndex = 0;
    target.tabIndex = -1;
  }
}).observe(document.documentElement, {
  childList: true, subtree: true, attributeFilter: ["role", "aria-selected", "tabindex"],
});

// Sliders are replaced with every step: the one that had the focus gets it back.
let slid = null;
document.addEventListener("pointerdown", () => { slid = null; }, true);
document.addEventListener("focusin", ({ target }) => { slid = target.closest(".slider [id]")?.id ?? null; });
new MutationObserver(() => {
  if (slid === null || document.activeElement !== document.body) return;
  document.getElementById(slid)?.querySelector("[role=slider]")?.focus();
}).observe(document.documentElement, { childList: true, subtree: true });

// The trials of a point are listed below the figure: after a click the page scrolls to them once they have arrived, and
// stays there while the figures above are redrawn, until the user scrolls.
const SETTLED_MS = 2000;
let followUntil = 0;
document.addEventListener("pointerup", ({ target }) => {
  followUntil = target.closest("#figure .js-plotly-plot") ? Infinity : 0;
}, true);
for (const input of ["wheel", "touchmove", "keydown", "pointerdown"]) {
  document.addEventListener(input, () => { followUntil = 0; }, { capture: true, passive: true });
}
new MutationObserver((changes) => {
  const trials = document.getElementById("trials");
  const arrived = changes.some(({ target, addedNodes }) => addedNodes.length && trials?.contains(target));
  if (arrived && followUntil) followUntil = performance.now() + SETTLED_MS;
  if (followUntil !== Infinity && performance.now() < followUntil) trials?.scrollIntoView({ block: "start" });
}).observe(document.documentElement, { childList: true, subtree: true });

// Inserts static parts (static_html.py) and formulas, which arrive as HTML or MathML in an attribute.
new MutationObserver(() => {
  for (const place of document.querySelectorAll("[data-html]")) {
    if (place.shown === place.dataset.html) continue;
    place.shown = place.innerHTML = place.dataset.html;
  }
}).observe(document.documentElement, { childList: true, subtree: true, attributeFilter: ["data-html"] });

// A table dropped on the page becomes the second data set.
document.addEventListener("dragover", (event) => event.preventDefault());
document.addEventListener("drop", async (event) => {
  event.preventDefault();
  const [file] = event.dataTransfer.files;
  if (!file) return;
  const answer = await fetch(`/drop?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
  if (answer.ok) { location.reload(); return; }
  document.getElementById("message").textContent = await answer.text();
});

// Follows a running campaign: reloads the page, with its state, when the data change, but not while the user is typing.
(async function follow(before) {
  const { version, follows } = await fetch("/live").then((answer) => answer.json()).catch(() => ({ version: before }));
  const typing = document.activeElement?.matches("input[type=text], input[type=search]");
  if (before !== undefined && version !== before && !typing) { location.reload(); return; }
  if (follows || before !== undefined) setTimeout(follow, 2000, before ?? version);
})();
