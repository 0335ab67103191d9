"use strict";
const by = id => document.getElementById(id);
const number = (value, digits, unit = "", factor = 1) =>
  value == null ? "–" : (factor * value).toFixed(digits).replace("-", "−") + (unit && " " + unit);

// ---- orders of the operator

/** The console works on STOP for 3 s and waits 5 s for the response to any other call; a frozen one accepts a call but never responds. */
const STOP_MS = 4000, CALL_MS = 7000;

/** What this page starts ends with it, whoever else watches; a page that is loaded again is another one. */
const PAGE = {"X-Trackway-Page": crypto.randomUUID()};

async function post(path, patience, body) {
  // The time of the state this page acts on: a console that was frozen must not obey old requests.
  const headers = {...PAGE, "X-Trackway": last?.at_s ?? 0, "Content-Type": "application/json"};
  const signal = AbortSignal.timeout(patience);
  return (await fetch(path, {method: "POST", headers, signal, body: JSON.stringify(body ?? {})})).json();
}

async function ask(path, name, body) {
  by("said").textContent = `${name} …`;
  try {
    const answer = await post(path, CALL_MS, body);
    by("said").textContent = `${name}: ${answer.success ? "" : "refused: "}${answer.message}`;
    return answer.success;
  } catch {
    by("said").textContent = `${name}: no answer from the console`;
    return false;
  }
}

async function stop() {
  by("said").textContent = "STOP …";
  try {
    const answer = await post("stop", STOP_MS);
    by("said").textContent = `STOP: ${answer.success ? "" : "NOT SEEN TO BE AT REST: "}${answer.message}`;
  } catch {
    by("said").textContent = "STOP: NO ANSWER FROM THE CONSOLE: cut the power";
  }
}

// When the button goes down, not when it is released.
by("stop").onpointerdown = event => { if (event.button === 0) stop(); };
by("stop").onclick = event => { if (event.detail === 0) stop(); };  // Enter, or a screen reader
by("acknowledge").onclick = () => ask("acknowledge", "seen");
document.addEventListener("keydown", event => {
  const typing = event.target.closest("input, select, textarea");
  if (event.key !== "Escape" && (event.key !== " " || typing)) return;
  event.preventDefault();
  if (!event.repeat) stop();
});
// Releasing the space bar would press the focused button.
document.addEventListener("keyup", event => {
  if (event.key === " " && !event.target.closest("input, select, textarea")) event.preventDefault();
});
for (const button of document.querySelectorAll("button[data-action]")) {
  button.onclick = () => ask(`call/${button.dataset.action}`, button.textContent);
}
by("queue").onclick = event => {
  const {order, trial} = event.target.dataset;
  if (order) ask("order", `${order} ${trial}`, {do: order, trial_id: trial});
};
by("add").onsubmit = event => {
  event.preventDefault();
  const form = new FormData(event.target);
  const condition = {phi: +form.get("phi"), omega_rad_s: +form.get("omega_rad_s"), replicates: +form.get("replicates")};
  if (form.get("gait")) condition.gait = form.get("gait");
  ask("order", "add", {do: "add", ...condition});
};

// ---- small parts

function made(kind, content, className) {
  const element = document.createElement(kind);
  element.textContent = content ?? "";
  if (className) element.className = className;
  return element;
}

function row(className, ...cells) {
  const tr = made("tr", "", className);
  tr.append(...cells.map(cell => cell instanceof Node ? cell : made("td", cell)));
  return tr;
}

/** Draw only what has changed: a table that is rebuilt loses focus and selection. */
const drawn = {};
function changed(what, content) {
  const text = JSON.stringify(content);
  if (drawn[what] === text) return false;
  drawn[what] = text;
  return true;
}

function list(id, entries) {
  if (!changed(id, entries)) return;
  by(id).replaceChildren(...entries.flatMap(([name, value, className]) =>
    [made("dt", name), made("dd", value, className)]));
}

const clock = at => new Date(at).toLocaleTimeString([], {hour12: false});
function span(seconds) {
  if (seconds == null) return "–";
  const whole = Math.round(seconds), h = Math.floor(whole / 3600), m = Math.floor(whole / 60) % 60;
  return h ? `${h} h ${m} min` : m ? `${m} min ${whole % 60} s` : `${whole} s`;
}
const bytes = value => value == null ? "–" : value > 1e9 ? (value / 1e9).toFixed(1) + " GB" : (value / 1e6).toFixed(1) + " MB";

// ---- figures

const colour = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const axis = title => ({title: {text: title, standoff: 6}, gridcolor: colour("line"), zerolinecolor: colour("line"), automargin: true});
const layout = (x, y, more = {}) => ({
  margin: {l: 52, r: 12, t: 8, b: 40}, uirevision: 1, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
  font: {color: colour("ink"), size: 12}, legend: {orientation: "h", y: 1.15, x: 0}, hovermode: "closest",
  xaxis: {...axis(x[0]), ...x[1]}, yaxis: {...axis(y[0]), ...y[1]}, ...more,
});
const options = {displayModeBar: false, responsive: true};
const line = (name, x, y, color, dash = "solid", more = {}) =>
  ({name, x, y, mode: "lines", connectgaps: false, line: {color, dash, width: 2}, ...more});

/** Limits around the values. Always set: an axis that was empty at first would keep meaningless limits. */
function limits(values, empty, least = 0) {
  const all = values.filter(value => value != null && Number.isFinite(value));
  if (!all.length) return empty;
  const low = Math.min(...all), high = Math.max(...all), room = 0.08 * Math.max(high - low, least);
  return [low - room, high + room];
}
const fromZero = (values, empty) => { const [low, high] = limits([0, ...values], empty); return [low < 0 ? low : 0, high || empty[1]]; };

/** Speeds [cm/s] that the figure always spans, so that a robot at rest is not seen to shake. */
const REST = [-1, 1];

function drawSpeed(speed) {
  if (!changed("speed", speed)) return;
  const cm = series => series.value.map(v => v == null ? null : 100 * v);
  const measured = cm(speed.measured), model = cm(speed.predicted), seen = [...measured, ...model].filter(v => v != null);
  Plotly.react("speed", [
    line("measured", speed.measured.t_s, measured, colour("measured")),
    line("model", speed.predicted.t_s, model, colour("model"), "dash"),
  ], layout(["time before the last frame [s]", {range: [-5, 0]}],
    ["v<sub>x</sub> [cm/s]", {range: fromZero(seen.length ? [...REST, ...seen] : [], [0, 40])}]), options);
}

function drawPacking(packing) {
  if (!changed("packing", packing)) return;
  const {points, target_phi: target, tolerance} = packing;
  const pulses = points.map(p => p.pulses);
  const band = target == null ? [] : [target - (tolerance ?? 0), target + (tolerance ?? 0)];
  const shapes = target == null ? [] : [
    {type: "rect", xref: "paper", x0: 0, x1: 1, y0: band[0], y1: band[1], fillcolor: colour("good"), opacity: 0.2, line: {width: 0}},
    {type: "line", xref: "paper", x0: 0, x1: 1, y0: target, y1: target, line: {color: colour("good"), width: 1.5, dash: "dash"}},
  ];
  const hover = p => `${p.pulses} pulses, φ = ${p.phi.toFixed(4)}, ${(1000 * p.height_m).toFixed(2)} mm`;
  const phi = {name: "φ", x: pulses, y: points.map(p => p.phi), mode: "lines+markers", text: points.map(hover), hoverinfo: "text",
    error_y: {type: "data", array: points.map(p => p.phi_sd ?? 0), color: colour("measured"), thickness: 1},
    line: {color: colour("measured")}};
  const height = {name: "height", x: pulses, y: points.map(p => 1000 * p.height_m), mode: "lines+markers", yaxis: "y2",
    line: {color: colour("model"), dash: "dot"}, marker: {symbol: "square-open"}, hoverinfo: "skip"};
  Plotly.react("packing", [phi, height], layout(
    ["air pulses", {tickformat: "d", range: [-0.3, Math.max(5, ...pulses) + 0.5]}],
    ["volume fraction φ", {tickformat: ".4~f", range: limits([...points.map(p => p.phi), ...band], [0.57, 0.64], 0.004)}],
    {shapes, margin: {l: 60, r: 60, t: 8, b: 40},
     yaxis2: {...axis("height [mm]"), overlaying: "y", side: "right", showgrid: false, tickmode: "auto", nticks: 6, tickformat: ".4~f", visible: points.length > 0,
               range: limits(points.map(p => 1000 * p.height_m), [0, 100])}}), options);
}

const DASHES = ["dash", "dashdot", "longdash", "longdashdot", "2px 4px", "8px 2px"];

/** Measured means with the model's curve and, until a verdict, the curves of the remaining explanations. */
function drawCurve(curves, trial, queue, rivals) {
  const target = trial.phi_target, at = phi => (+phi).toFixed(4);
  const measured = queue.filter(one => one.measured.speed_m_s != null);
  const left = rivals.filter(one => target != null && at(one.phi) === at(target));
  if (!changed("curve", [curves, target, trial.omega_rad_s, measured, left])) return;
  const here = one => target != null && at(one.phi) === at(target);
  const faint = {opacity: 0.5};
  const lines = Object.entries(curves).map(([phi, curve]) => {
    const mine = target != null && phi === at(target);
    return line(`model, φ ${(+phi).toFixed(3)}`, curve.omega_rad_s, curve.speed_m_s.map(v => 100 * v),
      colour("model"), mine ? "solid" : "dot", mine ? {} : {...faint, showlegend: false});
  });
  const explained = left.map((one, index) => line(one.explanation.replaceAll("_", " "), one.omega_rad_s,
    one.speed_m_s.map(v => 100 * v), colour("soft"), DASHES[index % DASHES.length]));
  const points = (some, name, more) => ({
    name, x: some.map(one => one.omega_rad_s), y: some.map(one => 100 * one.measured.speed_m_s), mode: "markers",
    error_y: {type: "data", array: some.map(one => 100 * (one.measured.speed_sd_m_s ?? 0)), thickness: 1},
    text: some.map(one => `${one.trial_id}: ${(100 * one.measured.speed_m_s).toFixed(2)} cm/s, φ = ${one.measured.phi?.toFixed(4)}`),
    hoverinfo: "text", marker: {color: colour("measured"), size: 9}, ...more});
  const others = measured.filter(one => !here(one)), ours = measured.filter(here);
  const shapes = trial.omega_rad_s == null ? [] : [{type: "line", yref: "paper", y0: 0, y1: 1, x0: trial.omega_rad_s,
    x1: trial.omega_rad_s, line: {color: colour("soft"), width: 1, dash: "dot"}}];
  const range = [0, Math.max(12, 1.25 * Math.max(0, ...queue.map(one => one.omega_rad_s), trial.omega_rad_s ?? 0))];
  const within = curve => curve.speed_m_s.filter((_, index) => curve.omega_rad_s[index] <= range[1]);
  const seen = [...Object.values(curves).flatMap(within), ...left.flatMap(within), ...measured.map(one => one.measured.speed_m_s)].map(v => 100 * v);
  Plotly.react("curve", [...lines, ...explained, points(others, "other φ", {...faint, marker: {color: colour("measured"), size: 7, symbol: "circle-open"}}),
    points(ours, target == null ? "measured" : `measured, φ ${(+target).toFixed(3)}`)],
    layout(["ω [rad/s]", {range}], ["v̄ [cm/s]", {range: fromZero(seen, [0, 40])}], {shapes, ...roomForNames(left.length)}), options);
}

/** Names of explanations are long: one per line above the figure, which grows accordingly. */
function roomForNames(count) {
  by("curve").style.setProperty("--names", count);
  return {height: by("curve").clientHeight, ...count ? {legend: {y: 1.02, yanchor: "bottom", x: 0}} : {}};
}

// ---- tables

const SIGN = {waiting: "○", running: "▶", done: "●", failed: "✕", skipped: "–"};
const OFFER = {waiting: ["skip"], failed: ["repeat"], skipped: ["repeat"], done: ["repeat"], running: []};

/** ``gone``: there is no campaign any more that could obey. */
function drawQueue(queue, gone) {
  if (!changed("queue", [queue, gone])) return;
  const body = by("queue").tBodies[0], focus = document.activeElement?.dataset ?? {};
  const key = document.activeElement?.closest("#queue") ? `${focus.order} ${focus.trial}` : null;
  body.replaceChildren(...queue.flatMap(one => {
    const name = made("td", SIGN[one.state], "state"), offers = made("td");
    name.title = `${one.trial_id}: ${one.state}`;
    for (const order of OFFER[one.state]) {
      const button = made("button", order);
      Object.assign(button.dataset, {order, trial: one.trial_id});
      button.disabled = gone;
      button.setAttribute("aria-label", `${order} ${one.trial_id}`);
      if (order === "repeat" && one.state === "done") button.title = "one replicate more of this condition";
      offers.append(button);
      if (key === `${order} ${one.trial_id}`) queueMicrotask(() => button.focus());
    }
    const gait = one.gait ? ` ${one.gait}` : "";
    const line = row(one.state, name, one.phi.toFixed(3), one.omega_rad_s.toFixed(1) + gait, String(one.replicate),
                     number(one.measured.speed_m_s, 2, "", 100).replace("–", ""), offers);
    line.title = one.because;
    const text = one.reason || (one.state === "running" ? one.because : "");
    if (!text || one.state === "skipped") return [line];
    // The log says where its bag is kept.
    const why = Object.assign(made("td", text.split("; its bag")[0], "why"), {colSpan: 5, title: text});
    return [line, row(`reason ${one.state}`, "", why)];
  }));
  [...body.querySelectorAll(".running")].at(-1)?.scrollIntoView({block: "nearest"});
}

function drawCampaign(campaign) {
  const ended = campaign.state === "ended", gone = !campaign.queue || ended || campaign.age_s > 5, queue = campaign.queue ?? [];
  const count = state => queue.filter(one => one.state === state).length;
  const over = count("done"), failed = count("failed"), left = count("waiting") + count("running");
  const parts = [`${over} of ${over + failed + left} done`, failed && `${failed} failed`, count("skipped") && `${count("skipped")} skipped`,
    left && campaign.left_s != null && campaign.state === "running" && `${span(campaign.left_s)} left, until ${clock(Date.now() + 1000 * campaign.left_s)}`];
  const numbers = parts.filter(Boolean).join(" · ");
  const state = !queue.length ? "no campaign is running" : ended ? `has ended: ${campaign.why}` : gone ? "is silent: killed or frozen"
    : campaign.state === "held" ? `HELD: ${campaign.why}`
    : campaign.state === "running" ? campaign.stage : campaign.state === "pausing" ? `${campaign.stage}; then it pauses` : campaign.state;
  by("campaign-name").textContent = campaign.campaign ?? "";
  by("campaign-state").textContent = [state, queue.length && numbers].filter(Boolean).join(" · ");
  by("campaign-state").className = !gone && campaign.state === "held" ? "held" : "soft";
  by("progress").max = Math.max(over + failed + left, 1);
  by("progress").value = over;
  by("pause").disabled = gone || campaign.state !== "running";
  by("go").disabled = gone || !["held", "pausing"].includes(campaign.state);
  for (const field of by("add").elements) field.disabled = gone;
  by("resume").textContent = ended && left + failed ? `to go on: trackway campaign ${campaign.folder}` : "";
  // Nobody can say go to a campaign that has ended; what was seen of legs and air stays.
  if (ended) by("said").textContent = by("said").textContent.replace(/; the campaign is held[^;]*until Go$/, "");
  drawQueue(queue, gone);
  drawVerdict(campaign.look);
}

/** In a campaign until a verdict: the last look, and which further effects may be present. */
function drawVerdict(look) {
  by("verdict-box").hidden = !look;
  if (!look || !changed("verdict", look)) return;
  by("verdict-of").textContent = `look ${look.look}`;
  by("verdict").textContent = look.text;
  by("possible").hidden = !look.possible.length;
  by("possible").tBodies[0].replaceChildren(...look.possible.map(one => {
    const sign = made("td", one.excluded ? "●" : "○", "state");
    sign.title = one.excluded ? "excluded" : one.within_reach ? "still possible" : "this plan can't show it";
    const times = one.e_value_against < 1000 ? one.e_value_against.toPrecision(2) : "> 1000";
    return row(one.excluded || !one.within_reach ? "soft" : "", sign, one.effect, one.share_of_usual < 1 ? "half its usual" : "usual", `${times} : 1`);
  }));
}

function drawLog(own, events) {
  if (!changed("log", [own, events])) return;
  const speed = one => one.measured?.speed_m_s != null && `${(100 * one.measured.speed_m_s).toFixed(2)} cm/s`;
  const told = events.map(one => ({at: one.at, who: one.who,
    text: [one.do, one.trial_id, one.reason, one.followed, one.text, speed(one)].filter(Boolean).join(" ")}));
  const lines = [...own, ...told].sort((a, b) => b.at.localeCompare(a.at)).slice(0, 100);
  by("log").tBodies[0].replaceChildren(...lines.map(one => row("", clock(one.at), one.who, one.text)));
}

function drawNodes(nodes, topics) {
  const shown = Object.entries(nodes).map(([name, one]) =>
    [one.state, name, one.state === "ok" ? "ok" : one.state === "silent" ? `silent for ${one.age_s.toFixed(0)} s` : one.text]);
  if (changed("nodes", shown)) {
    by("nodes").tBodies[0].replaceChildren(...shown.map(([state, name, text]) =>
      row(state, made("td", {ok: "●", gone: "○"}[state] ?? "▲", "state"), name, text)));
  }
  const lines = Object.entries(topics).map(([name, one]) => [one.state, name, {waiting: "–", quiet: "quiet", held: "held"}[one.state]
    ?? (one.state === "silent" ? `silent for ${one.age_s.toFixed(0)} s` : `${one.rate_hz.toFixed(1)} Hz`)]);
  if (!changed("topics", lines)) return;
  const silent = lines.filter(([state]) => state === "silent").map(([, name]) => name);
  by("topics-say").textContent = silent.length ? `Topics: ${silent.join(", ")} silent` : "Topics: none missing";
  by("topics-say").className = silent.length ? "over" : "";
  by("topics").tBodies[0].replaceChildren(...lines.map(([state, name, text]) =>
    row(state, made("td", {ok: "●", held: "●", silent: "▲"}[state] ?? "○", "state"), name, text)));
}

const shown = {};
function drawPictures(pictures) {
  for (const [camera, {number: count, seen}] of Object.entries(pictures)) {
    // One at a time: on a slow line there are fewer, which leaves room for the rest.
    if (shown[camera] === count || !by(camera).complete) continue;
    shown[camera] = count;
    by(camera).src = `camera/${camera}.jpg?n=${count}`;
    const title = camera[0].toUpperCase() + camera.slice(1) + " camera ";
    by(`${camera}-says`).replaceChildren(title, ...(seen.length ? seen.flatMap(name => [made("span", name.replace("_", " "), `mark ${name}`), " "])
      : [made("span", "no mark tracked", "over")]));
  }
}

function drawFigures(state) {
  const v = state.values, bed = state.bed, height = parseFloat(bed.height_m), phi = parseFloat(bed.phi);
  list("figures", [
    ["bed", bed.stage ?? "–"],
    ["φ", Number.isFinite(phi) ? `${phi.toFixed(4)} ± ${parseFloat(bed.phi_sd).toFixed(4)}` : "–"],
    ["bed height", Number.isFinite(height) ? (1000 * height).toFixed(1) + " mm" : "–"],
    ["mean speed", number(v.speed_mean_m_s, 2, "cm/s", 100)],
    ["model's mean speed", number(v.model_speed_mean_m_s, 2, "cm/s", 100)],
    ["measured − model", number(v.model_error_m_s, 2, "cm/s", 100)],
    ["lift", number(v.lift_m, 2, "mm", 1000)],
  ]);
  const r = state.recorder;
  list("recorder", r.written == null ? [] : [
    ["rate", r.rate_bytes_s == null ? "–" : bytes(r.rate_bytes_s) + "/s"],
    ["messages written", String(r.written)],
    ["lost", String(r.lost), r.lost ? "over" : ""],
    ["disk free", bytes(r.free_bytes)],
    ["full in", r.left_s == null ? "–" : r.left_s > 86400 ? "more than a day" : span(r.left_s), r.left_s != null && r.left_s < 600 ? "over" : ""],
  ]);
  list("timing", Object.entries(state.timing));
}

function drawTrial(trial) {
  const parts = [trial.trial_id, trial.gait, trial.omega_rad_s == null ? null : `ω = ${trial.omega_rad_s} rad/s`,
                 trial.phi_target == null ? null : `φ target ${(+trial.phi_target).toFixed(3)}`];
  by("trial").textContent = trial.trial_id ? parts.filter(part => part != null).join(" · ") : "no trial announced";
}

// ---- state from the console

/** What must be shown at once, and is cheap to draw. */
function drawSafety(state) {
  by("connection").textContent = "live";
  by("connection").className = "soft";
  document.body.classList.remove("old");
  const held = state.campaign.state === "held" && state.campaign.age_s <= 5;
  by("safety").textContent = held ? `campaign HELD until Go: ${state.safety.text}` : state.safety.text;
  by("safety").className = state.safety.state;
  by("acknowledge").hidden = state.safety.state !== "overlapped";
}

function drawLinks(state) {
  by("explorer").href = `${location.protocol}//${location.hostname}:${state.explorer_port}/`;
  by("explorer").title = `trackway explore ${state.campaign.folder ?? "DATA"}`;
}

const PARTS = [
  state => drawTrial(state.trial), state => drawCampaign(state.campaign), drawFigures, state => drawSpeed(state.speed),
  state => drawPacking(state.packing), state => drawCurve(state.curves, state.trial, state.campaign.queue ?? [], state.campaign.look?.rivals ?? []),
  state => drawPictures(state.pictures), state => drawNodes(state.nodes, state.topics),
  state => drawLog(state.log, state.campaign.events ?? []), drawLinks,
];
const PERIOD_MS = 200, OLD_MS = 2000;
const pause = ms => new Promise(then => setTimeout(then, ms));
let last = null, heard = performance.now(), wake = () => {};

/** Draws the newest state, part by part, and rests four times as long as it worked: STOP never waits behind a figure. */
async function keepDrawn() {
  for (let state = null; ;) {
    if (state === last) await new Promise(then => { wake = then; });
    state = last;
    for (const part of PARTS) {
      const begun = performance.now();
      part(state);
      await pause(4 * (performance.now() - begun));
    }
  }
}
keepDrawn();

function lost() {
  document.body.classList.add("old");
  by("connection").textContent = "connection lost; what is shown is old";
  by("connection").className = "lost";
  by("safety").textContent = "not known: the console does not answer";
  by("safety").className = "unknown";
}

/**
 * Asks again once it is answered: no state is older than its request, a slow line brings fewer states and not later
 * ones, and of the six connections that a browser has per host one is always free for STOP, however many pages are open.
 */
async function keepHearing() {
  for (;;) {
    const asked = performance.now();
    try {
      const state = await (await fetch("state", {headers: PAGE, signal: AbortSignal.timeout(OLD_MS)})).json();
      heard = asked;
      last = state;
      drawSafety(last);
      wake();
    } catch {
      lost();
    }
    await pause(Math.max(PERIOD_MS - (performance.now() - asked), PERIOD_MS / 4));
  }
}
keepHearing();
setInterval(() => { if (performance.now() - heard > OLD_MS) lost(); }, 500);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const name of ["speed", "packing", "curve"]) delete drawn[name];
  last = last && {...last};
  wake();
});
