"""simulate: the four devices on pseudo-terminals FOLDER/bed, legs, dorsal and lateral, to test drivers on.

They are connected to the virtual lab's bed, robot and cameras. Lines on standard input unplug a cable (`pull legs`) and
plug it back in (`plug legs`); what the devices do by themselves is printed.
"""

import argparse
import math
import queue
import sys
import threading
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from sandbot_common import cli
from sandbot_common.config import config_file
from sandbot_common.errors import InputError
from sandbot_common.robot import SANDBOT, read_robot

PHI_LOW, PHI_HIGH = 0.5, 0.7


def main(argv: Sequence[str] | None = None) -> int:
    """Run until Ctrl-C."""
    return cli.run(_simulate, argv)


def _options(argv: Sequence[str]) -> argparse.Namespace:
    """The arguments, checked. Raises InputError."""
    parser = cli.Parser(prog="simulate", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="where the terminals appear")
    parser.add_argument("--cameras", type=Path, help="cameras.yaml (default: the project's own)")
    parser.add_argument("--robot", type=Path, help="robot.yaml (default: SandBot)")
    parser.add_argument("--seed", type=int, default=1, help="random seed of bed and cameras (default: 1)")
    parser.add_argument(
        "--trial-seed", type=int, default=0, help="random seed of every trial; 0: another one each time (default: 0)"
    )
    parser.add_argument(
        "--lease",
        type=float,
        default=0.24,
        metavar="S",
        help="time without a set-point after which the legs rest (default: 0.24)",
    )
    parser.add_argument("--phi", type=float, default=0.0, help="ground the robot walks on (default: the bed's own)")
    options: argparse.Namespace = parser.parse_args(argv)
    for name, seed in (("--seed", options.seed), ("--trial-seed", options.trial_seed)):
        if seed < 0:
            raise InputError(f"{name}: {seed} is not a seed; 0 or more")
    if not 0 < options.lease < math.inf:
        raise InputError(f"--lease {options.lease}: a time above 0 s")
    if options.phi != 0 and not PHI_LOW <= options.phi <= PHI_HIGH:
        raise InputError(f"--phi {options.phi}: {PHI_LOW} to {PHI_HIGH}, or 0 for the bed's own")
    return options


def _simulate(argv: Sequence[str]) -> int:
    options = _options(argv)
    # Imported only once the options are parsed, so that --help and errors are quick.
    from sandbot_hardware.simulate import PORTS, Trackway, obey

    robot = read_robot(options.robot) if options.robot else SANDBOT
    cameras = options.cameras or config_file("cameras.yaml")
    trackway = Trackway(options.folder, cameras, robot, options.seed, options.phi, options.lease, options.trial_seed)
    orders: queue.SimpleQueue[str] = queue.SimpleQueue()

    def listen() -> None:
        for line in sys.stdin:
            orders.put(line)

    threading.Thread(target=listen, name="stdin", daemon=True).start()
    print("devices: " + " ".join(str(options.folder / name) for name in PORTS), flush=True)
    with closing(trackway):
        while True:
            trackway.step()
            while not orders.empty():
                try:
                    obey(trackway, orders.get())
                except InputError as error:  # mistyped: the devices go on
                    print(f"error: {error}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
