"use strict";
// Saves a drawn figure as SVG or PNG for a paper, or its numbers as CSV. Shared by the report and the explorer.
window.sandbotExport = (() => {
  const PNG_SCALE = 3;

  const plain = (text) => String(text ?? "").replace(/<br>/g, " ").replace(/<[^>]+>/g, "");
  const quoted = (cell) => {
    const text = plain(cell);
    return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  const axesOf = (layout, letter) => Object.entries(layout).filter(([key]) => key.startsWith(`${letter}axis`));

  // Title of an axis that a trace names, such as x2. Inner panels have none and take that of the outer panels, if all of
  // these are the same.
  function titleOf(layout, name) {
    const [letter, number] = [name[0], name.slice(1)];
    const own = layout[`${letter}axis${number}`]?.title?.text;
    const all = new Set(axesOf(layout, letter).map(([, axis]) => axis?.title?.text).filter(Boolean));
    return own || (all.size === 1 ? [...all][0] : letter);
  }

  // A panel without a title is named by its y axis; a figure's only panel has no name.
  function panelOf(layout, x, y) {
    const title = layout.meta?.panels?.[Number(x.slice(1) || 1) - 1];
    return title ?? (axesOf(layout, "y").length > 1 ? titleOf(layout, y) : "");
  }

  function* cellsOf(map, across) {
    for (const [row, y] of map.y.entries()) {
      for (const [column, x] of map.x.entries()) {
        const value = map.customdata?.[row][column][0] ?? map.z[row][column];
        yield [map.name, y, across, x, map.colorbar.title.text, value, ""];
      }
    }
  }

  function* pointsOf(trace, panel, across, up) {
    for (const [i, x] of Array.from(trace.x ?? []).entries()) {
      if (x === null || trace.y[i] === null) continue;
      yield [panel, trace.name, across, x, up, trace.y[i], trace.error_y?.array?.[i] ?? ""];
    }
  }

  function rowsOf(trace, layout) {
    if (trace.mode === "text") return []; // labels of a map repeat its numbers
    const [x, y] = [trace.xaxis ?? "x", trace.yaxis ?? "y"];
    const across = titleOf(layout, x);
    if (trace.type === "heatmap") return cellsOf(trace, across);
    return pointsOf(trace, panelOf(layout, x, y), across, titleOf(layout, y));
  }

  // One row per point or map cell, with the axis titles, including units, as names. A map counts as a panel, and each of
  // its rows as a series.
  function csv(plot) {
    const rows = [["panel", "series", "x name", "x", "y name", "y", "error"]];
    for (const trace of plot.data) rows.push(...rowsOf(trace, plot.layout));
    return rows.map((row) => row.map(quoted).join(",")).join("\n") + "\n";
  }

  function download(content, name) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([content], { type: "text/csv;charset=utf-8" }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 0);
  }

  function save(plot, format, name) {
    if (format === "csv") return Promise.resolve(download(csv(plot), `${name}.csv`));
    const size = { width: plot.offsetWidth, height: plot.offsetHeight };
    return Plotly.downloadImage(plot, { format, filename: name, scale: format === "png" ? PNG_SCALE : 1, ...size });
  }

  return { csv, save };
})();
