"""explore: one page on this host to compare model and trials, switch effects on and watch the error fall."""

# The page and all that fits are imported only once the options are parsed, so that --help is answered at once.

import argparse
import logging
import multiprocessing
import os
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.files import base_name
from sandbot_common.parallel import one_per_cpu
from sandbot_common.worker_options import count
from sandbot_model.discovery.selection import Selection, from_query, read_selection, to_query, with_formula
from sandbot_model.tools import arguments

if TYPE_CHECKING:
    from flask import Flask

    from sandbot_model.data.conditions import Cells
    from sandbot_record.trials.table import Trials

NICE = 5
"""Niceness of workers: they yield to the page, but not too much to other programs, for they run discoveries, too."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; Ctrl-C ends the whole process at once."""
    code = cli.run(_explore, argv)
    return _exit_now(code) if code == cli.INTERRUPTED else code


def _exit_now(code: int) -> NoReturn:
    """Exit at once, without waiting for threads that still answer or for workers that fit in advance.

    A pool whose workers were killed would report an error in every thread that waits for a fit, and would wait for ever
    for the rest of a message that was being sent.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.stdout.flush()
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.__stderr__.fileno())  # type: ignore[union-attr]
    for worker in multiprocessing.active_children():
        worker.kill()
    os._exit(code)


def _parser() -> cli.Parser:
    parser = cli.Parser(prog="explore", description=__doc__)
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA", help="a campaign folder, bags, or a trials CSV")
    arguments.add_setting(parser)
    arguments.add_penetrometer(parser)
    arguments.add_bed(parser)
    parser.add_argument("--beside", type=Path, metavar="DATA", help="another data set to show with the same effects")
    parser.add_argument("--port", type=int, default=8050, help="port on this host (default: 8050; 0: any free one)")
    arguments.add_catalogue(parser)
    parser.add_argument("--selection", type=Path, metavar="FILE.yaml", help="open in the state saved with 'Save YAML'")
    parser.add_argument(
        "--workers",
        type=count,
        default=min(4, one_per_cpu().size),
        metavar="N",
        help="processes that fit in advance (default: one per CPU, 4 at most)",
    )
    parser.add_argument("--title", default=None, help="title of the page (default: the name of DATA)")
    return parser


def _explore(argv: Sequence[str]) -> None:
    args = _parser().parse_args(argv)
    if not 0 <= args.port <= 65535:
        raise InputError(f"--port {args.port} is not between 0 and 65535")
    arguments.criteria(args)
    query = to_query(_initial_selection(args))
    title = arguments.title(args)
    arguments.check_setting(args)
    _listen(args.port).close()  # a port in use is reported before any fit; workers would inherit an open socket
    from sandbot_common.restarting_pool import RestartingPool
    from sandbot_common.workers import pool
    from sandbot_record.bags.reader import is_bag

    campaigns = [path for path in args.data if path.is_dir() and not is_bag(path)]
    spawned = partial(pool, args.workers, "spawn", also=partial(_begin_anew, args.effects_from))
    workers = RestartingPool(pool(args.workers, "fork", also=_lower_priority), anew=spawned)
    # SIGTERM (from a launcher, a test) is handled like Ctrl-C.
    signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGINT))
    servers = _Servers(args, title, query, workers)
    try:
        read = servers.read()
    except InputError as error:
        # A missing path is a mistake on the command line; data that can't be used are reported on the page.
        if not all(path.exists() for path in args.data):
            raise
        from sandbot_model.explore import no_data

        print(f"explore: {error}", file=sys.stderr, flush=True)
        first, robot_line = no_data.app(title, str(error), again=bool(campaigns)), ""
    else:
        first, robot_line = servers.of(*read), read[1]
    _serve(servers, first, campaigns, robot_line)


def _initial_selection(args: argparse.Namespace) -> Selection:
    """The saved selection, if any, with the formulas of ``--effect``. Raises InputError."""
    saved = read_selection(args.selection) if args.selection else Selection()
    for text in args.effect:
        saved = with_formula(saved, text)
    return saved


class _Servers:
    """Makes servers for the current data, by the options of the command line and with one pool of workers."""

    def __init__(self, args: argparse.Namespace, title: str, query: str, workers: Executor) -> None:
        self.args, self._title, self.query, self._workers = args, title, query, workers

    def read(self) -> "tuple[Trials, str, Cells]":
        """The trials, a line on their robot, and their cells. Raises InputError."""
        trials, robot_line = arguments.trials(self.args)
        arguments.notes(self.args, trials)
        return trials, robot_line, arguments.cells(self.args, trials)

    def current(self, dropped: Path | None) -> "Flask":
        """A server for the data as they are now, and for a table dropped on the page, if any."""
        return self.of(*self.read(), dropped)

    def of(self, trials: "Trials", robot_line: str, cells: "Cells", dropped: Path | None = None) -> "Flask":
        """A server for these trials. Raises InputError for an option that they can't use."""
        from sandbot_model.data.conditions import cells_of
        from sandbot_model.explore.app import Beside, Explorer
        from sandbot_model.explore.session import Session

        args = self.args
        arguments.check_bed(args, cells)
        own = {"effect_files": args.effects_from, "criteria": arguments.criteria(args)}
        beside = None
        if (path := dropped or args.beside) is not None:
            other = cells_of(arguments.beside(args, trials, path))
            beside = Beside(Session(other, self._workers, **own), base_name(path))
        session = Session(cells, self._workers, **own)
        session.catalogue()
        # Workers are forked here, before the server has threads, and inherit the user's effects.
        self._workers.submit(os.getpid).result()
        options = [word for path in args.effects_from for word in ("--effects-from", str(path))]
        for name in ("penetrometer", "robot", "cameras"):
            if (path := getattr(args, name)) is not None:
                options += [f"--{name}", str(path)]
        explorer = Explorer(session, trials, args.data, self._title, beside, options, robot_line)
        # Fitted before the address is printed, so that the page is ready; errors will be shown on it.
        with suppress(InputError):
            session.ladder(from_query(self.query))
        found: Flask = explorer.app().server
        return found


def _lower_priority() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.nice(NICE)


def _begin_anew(effect_files: Sequence[Path]) -> None:
    """Prepare a worker that inherits nothing: tasks name users' effects by the modules of their files."""
    from sandbot_model.physics.catalogue import catalogue

    _lower_priority()
    catalogue(effect_files)


def _listen(port: int) -> socket.socket:
    from sandbot_model.explore.loopback import HOST

    try:
        return socket.create_server((HOST, port))
    except OSError as error:
        raise InputError(f"--port {port}: {error.strerror}; another explorer may be running, try --port 0") from None


def _serve(servers: _Servers, first: "Flask", campaigns: Sequence[Path], robot_line: str) -> None:
    from werkzeug.serving import make_server

    from sandbot_model.explore.live import Live
    from sandbot_model.explore.loopback import HOST

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    listening = _listen(servers.args.port)
    port = listening.getsockname()[1]
    ended = threading.Event()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as dropped:
        live = Live(servers.current, first, Path(dropped), campaigns)
        server = make_server(HOST, port, live, threaded=True, fd=listening.fileno())
        if campaigns:
            threading.Thread(target=live.follow, args=(ended,), name="follow", daemon=True).start()
        address = f"explore: http://{HOST}:{port}/{servers.query}  (Ctrl-C ends it)"
        print(address, *([robot_line] if robot_line else []), sep="\n", flush=True)
        # Returns only after Ctrl-C, which werkzeug swallows: raised again below.
        try:
            server.serve_forever()
        finally:
            ended.set()
    raise KeyboardInterrupt


if __name__ == "__main__":
    raise SystemExit(main())
