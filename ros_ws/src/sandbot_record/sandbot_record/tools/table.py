"""table: make the trials table (trials.csv) from bags; exit code 1: bags that give no row were skipped."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sandbot_common import cli
from sandbot_common.files import check_output, writing
from sandbot_common.terminal import counted
from sandbot_common.worker_options import add_worker_options, refuse_worker_options, workers_of
from sandbot_record.bags import reader
from sandbot_record.trials import from_bags as table
from sandbot_record.trials.csv_table import to_csv, write_csv
from sandbot_record.trials.read import read
from sandbot_record.trials.table import MEASURED, OK, REQUIRED, Trials


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; exit code 1 if bags were skipped."""
    return cli.run(_table, argv)


def _table(argv: Sequence[str]) -> int:
    parser = cli.Parser(prog="table", description=__doc__)
    parser.add_argument("data", nargs="+", type=Path, metavar="DATA", help="a campaign folder, bags or trials CSVs")
    parser.add_argument(
        "--out", type=cli.output, help="the CSV to write (default: trials.csv in the campaign folder, else print)"
    )
    add_worker_options(parser, "read the bags of a folder")
    options = parser.parse_args(argv)
    first = options.data[0]
    if len(options.data) == 1 and first.is_dir() and not reader.is_bag(first):
        out = options.out or check_output(first / table.TRIALS_CSV)
        # Absolute, because the workers of a cluster have another working directory.
        with workers_of(options) as workers:
            workers.check(first)
            report = table.make(first.absolute() if options.dask else first, workers, out)
        _tell(report.trials, report.skipped, out, of_bags=bool(report.bags))
        return 1 if report.skipped else 0
    refuse_worker_options(options, "only the bags of one folder are shared out; these are read one by one")
    out = options.out and table.check_no_column_lost(options.out)
    rows = read(options.data)
    if out is not None:
        with writing(out):
            write_csv(rows, out)
    else:
        print(to_csv(rows), end="")
    _tell(rows, {}, out, of_bags=False)
    return 0


def _tell(rows: Trials, skipped: Mapping[Path, str], out: Path | None, *, of_bags: bool) -> None:
    """Say what was written to ``out``, and what is odd about it."""
    if out is not None:
        usable = f"{rows.excluded} not usable"
        print(f"{out}: {counted(len(rows), 'trial')}, {usable}, {counted(len(skipped), 'bag')} skipped")
    lines = [f"note: {line}" for line in rows.unread]
    lines += [f"not usable: {row.trial_id}: {row.status}" for row in rows.select(rows.status != OK).rows()]
    lines += [f"skipped: {line}" for line in skipped.values()]
    gaps = _gaps(rows.select(rows.usable)) if of_bags else []
    lines += [f"not measured: {line} (info on a bag says why)" for line in gaps]
    # Not mixed with the table on standard output, which may be redirected to a file.
    print(*lines, sep="\n", end="\n" if lines else "", file=sys.stderr if out is None else sys.stdout)


def _gaps(usable: Trials) -> list[str]:
    """In how many trials, at which frequencies, each column besides the mean speed has no value."""
    missing = {name: np.isnan(getattr(usable, name)) for name in MEASURED if name not in REQUIRED}
    return [
        f"{name} in {gap.sum()} of {len(usable)} usable trials, at "
        f"{', '.join(f'{omega:g}' for omega in np.unique(usable.omega_rad_s[gap]))} rad/s"
        for name, gap in missing.items()
        if gap.any()
    ]


if __name__ == "__main__":
    raise SystemExit(main())
