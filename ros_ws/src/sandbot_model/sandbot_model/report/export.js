"use strict";
// Saves a drawn figure as SVG or PNG for a paper, or its numbers as CSV. Shared by the report and the explorer.
window.sandbotExport = (() => {
  const PNG_SCALE = 3;

  const plain = (text) => String(text ?? "").replace(/<br>/g, " ").replace(/<[^>]+>/g, "");
  const quoted = (cell) => {
    const text = plain(cell);
    return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  const titleOf = (layout, letter) =>
    Object.entries(layout)
      .filter(([key]) => key.startsWith(`${letter}axis`))
      .map(([, axis]) => axis?.title?.text)
      .find(Boolean);

  function* rowsOf(trace) {
    if (trace.type === "heatmap") {
      for (const [row, y] of trace.y.entries()) {
        for (const [column, x] of trace.x.entries()) {
          yield [y, x, trace.customdata?.[row][column][0] ?? trace.z[row][column], ""];
        }
      }
      return;
    }
    if (trace.mode === "text") return; // what the map says in words stands in it as numbers
    for (const [i, x] of Array.from(trace.x ?? []).entries()) {
      if (x !== null && trace.y[i] !== null) yield [trace.name, x, trace.y[i], trace.error_y?.array?.[i] ?? ""];
    }
  }

  // One row a point: series, x, y, error; the axes' titles carry the units.
  function csv(plot) {
    const map = plot.data.findLast((trace) => trace.type === "heatmap");
    const value = map ? map.colorbar.title.text.replace("<br>", " ") : (titleOf(plot.layout, "y") ?? "y");
    const rows = [["series", titleOf(plot.layout, "x") ?? "x", value, "error"]];
    for (const trace of plot.data) rows.push(...rowsOf(trace));
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
