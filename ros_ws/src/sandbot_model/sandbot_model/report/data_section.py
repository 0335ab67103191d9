"""The data section of the page: every cell, as a table and as embedded files."""

import csv
import io
import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from sandbot_model.discovery.result import Discovery
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.report import text
from sandbot_model.report.page import Download, Section, Table, data_uri
from sandbot_model.report.view import Provenance, Step, measured, residual_z, scatter


def data(steps: tuple[Step, ...], provenance: Provenance, downloads: list[Download]) -> Section:
    """Trials used and excluded, all cells, and files to download."""
    line = f"{text.counted(provenance.used, 'trial')} used, {len(provenance.excluded)} excluded."
    tables = [_cell_table(steps)]
    if provenance.excluded:
        tables.insert(0, Table("Trials excluded", ("trial", "why"), list(provenance.excluded), (True, True)))
    sheet = Download("cells.csv", "Cells as CSV (SI units)", data_uri(cells_csv(steps).encode(), "text/csv"))
    return Section("data", "Data", text=(line,), tables=tuple(tables), downloads=(sheet, *downloads))


def _cell_table(steps: tuple[Step, ...]) -> Table:
    cells = steps[0].fit.cells
    head = ["φ", "ω (rad/s)", "trials"]
    trials = cells.n[:, Observable.speed]
    phi = cells.level_phi[cells.level]
    columns = [[f"{p:.3f}" for p in phi], [f"{w:.4g}" for w in cells.omega], [str(n) for n in trials]]
    for name in cells.observables:
        head.append(Observable[name].heading)
        pairs = zip(CM * measured(cells, name), CM * scatter(cells, name), strict=True)
        columns.append([f"{text.number(m, 2)} ± {text.number(s, 2)}" if np.isfinite(m) else "–" for m, s in pairs])
    determined = [step for step in steps if not step.fit.undetermined]
    for step in determined:
        head.append(f"speed, {step.label} (cm/s)")
        columns.append([text.centi(value) for value in step.fit.predicted[:, Observable.speed]])
    rows = list(zip(*columns, strict=True))
    spread = "error bars (r.m.s.)" if cells.error_bars else "standard deviation of a single trial"
    caption = f"All cells, by the φ of their level: mean ± {spread}"
    caption += ", and the modelled speed" if determined else ""
    return Table(caption, tuple(head), rows, (False,) * len(head), folded=True)


def cells_csv(steps: tuple[Step, ...]) -> str:
    """Cell means, scatter, and every step's prediction and residual; SI units in the names, unknown values empty."""
    cells = steps[0].fit.cells
    columns: dict[str, Iterable[Any]] = {"phi": cells.phi, "omega_rad_s": cells.omega, "gait": cells.gait}
    for name in cells.observables:
        observable = Observable[name]
        columns |= {
            f"{name}_n": cells.n[:, observable],
            observable.column: cells.mean[:, observable],
            observable.column.replace(name, f"{name}_sd"): cells.sd[:, observable],
        }
        for step in steps:
            tag = _tag(step)
            columns[f"{observable.column}[{tag}]"] = step.fit.predicted[:, observable]
            columns[f"{name}_z[{tag}]"] = residual_z(step.fit, name)
    sheet = io.StringIO()
    writer = csv.writer(sheet, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_csv_cell(v) for v in row] for row in zip(*columns.values(), strict=True))
    return sheet.getvalue()


def _tag(step: Step) -> str:
    """The model of a column: its effects, and the values held by hand."""
    held = ", ".join(f"{name}={value:.7g}" for name, value in step.fit.model.held.items())
    return ("+".join(step.fit.effects) or "base") + (f"; held by hand: {held}" if held else "")


def _csv_cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.7g}" if np.isfinite(value) else ""
    return str(value)


def json_download(discovery: Discovery) -> Download:
    """The discovery in the format of discover --json."""
    content = json.dumps(discovery.to_dict(), indent=1, ensure_ascii=False, allow_nan=False).encode()
    return Download("discovery.json", "Discovery as JSON (SI units)", data_uri(content, "application/json"))
