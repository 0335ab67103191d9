"use strict";
// One time cursor for film, legs and records: scrubbed, or played at a fraction of real time.
(() => {
  const { scene, frames, figures } = JSON.parse(document.getElementById("scene").textContent);
  const byId = (id) => document.getElementById(id);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const [clock, play, pace, film, plot] = ["clock", "play", "pace", "film", "plot-records"].map(byId);
  const start = Math.min(0, scene.time[0]);
  let last = null; // time of the previous animation frame while playing
  let shown = -1;

  function nearest(times, t) {
    let [low, high] = [0, times.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t) low = middle; else high = middle;
    }
    return t - times[low] <= times[high] - t ? low : high;
  }

  // Distance walked, by which the ground is moved; gaps in v_x count as rest.
  const walked = scene.time.map(() => 0);
  for (let i = 1; i < walked.length; i += 1) {
    walked[i] = walked[i - 1] + (scene.speed[i] ?? 0) * (scene.time[i] - scene.time[i - 1]);
  }

  function moveLeg(t) {
    const i = nearest(scene.legTime, t);
    const axle = scene.axle[i] / scene.radius; // the picture is in leg radii
    byId("robot").setAttribute("transform", `translate(0 ${-axle})`);
    scene.legs.forEach((angles, leg) => {
      const part = byId(`leg-${leg}`);
      part.setAttribute("transform", `rotate(${(angles[i] * 180) / Math.PI})`);
      part.classList.toggle("holds", scene.holds[leg][i]);
    });
    const ground = byId("ground");
    const passed = (walked[nearest(scene.time, t)] / scene.radius) % Number(ground.dataset.period);
    ground.setAttribute("transform", `translate(${-passed} 0)`);
    return i;
  }

  function number(value, unit) {
    return value === null ? "not seen" : `${value.toFixed(1).replace("-", "−")} ${unit}`;
  }

  function show(t) {
    clock.value = t;
    const i = moveLeg(t);
    const legs = ["A", "B"].map((name, leg) => `leg ${name} ${scene.holds[leg][i] ? "holds" : "is free"}`).join(", ");
    byId("reading").textContent = `t = ${t.toFixed(2)} s: measured ${number(scene.speed[nearest(scene.time, t)], "cm/s")}, ` +
      `model ${number(scene.model[i], "cm/s")}; ${legs}`;
    clock.setAttribute("aria-valuetext", byId("reading").textContent);
    if (frames.length) {
      const frame = nearest(frames, t);
      if (frame !== shown) film.src = film.dataset.address.replace("FRAME", frame);
      shown = frame;
    }
    const { _fullLayout: layout } = plot;
    if (!layout) return;
    byId("cursor").style.left = `${layout._size.l + layout.xaxis.l2p(t)}px`;
  }

  function tick(now) {
    if (last === null) return;
    const t = Number(clock.value) + ((now - last) / 1000) * Number(pace.value);
    last = now;
    if (t >= scene.end) stop(); else requestAnimationFrame(tick);
    show(Math.min(t, scene.end));
  }

  function stop() {
    last = null;
    play.textContent = "Play";
  }

  function draw() {
    const theme = dark.matches ? "dark" : "light";
    const options = { responsive: true, displaylogo: false, modeBarButtons: [["zoom2d", "pan2d", "resetScale2d"]] };
    const drawn = Object.entries(figures).map(([name, themes]) =>
      Plotly.react(`plot-${name}`, themes[theme].data, themes[theme].layout, options));
    return Promise.all(drawn).then(() => {
      show(Number(clock.value));
      document.documentElement.dataset.drawn = theme;
    });
  }

  play.addEventListener("click", () => {
    if (last !== null) { stop(); return; }
    if (Number(clock.value) >= scene.end - 1e-3) show(start);
    play.textContent = "Pause";
    last = performance.now();
    requestAnimationFrame(tick);
  });
  clock.addEventListener("input", () => show(Number(clock.value)));
  plot.addEventListener("click", ({ clientX }) => {
    const { _fullLayout: layout } = plot;
    const t = layout.xaxis.p2l(clientX - plot.getBoundingClientRect().left - layout._size.l);
    if (t >= start && t <= scene.end) show(t);
  });
  document.addEventListener("click", ({ target }) => {
    const { format, figure } = target.dataset ?? {};
    if (format) window.sandbotExport.save(byId(`plot-${figure}`), format, figure);
  });
  dark.addEventListener("change", draw);
  draw().then(() => plot.on("plotly_relayout", () => show(Number(clock.value))));
})();
