"""``ros2 launch sandbot_bringup trackway.launch.py``: the workspace's node table as processes."""

from collections.abc import Sequence
from pathlib import Path

from ros2cli_fallback.cover import Failure, NotCovered, Parser
from ros2cli_fallback.packages import executable
from ros2cli_fallback.processes import Group, Process, run_until_signalled
from sandbot_bringup import node_table
from sandbot_common.errors import InputError
from sandbot_common.shared_memory import note_shortage


def main(argv: Sequence[str]) -> int:
    """``launch sandbot_bringup trackway.launch.py [name:=value ...]``."""
    parser = Parser(prog="ros2 launch", description="Run a launch file.")
    parser.add_argument("-s", "--show-args", "--show-arguments", action="store_true", help="show launch arguments")
    parser.add_argument("package_name", help="sandbot_bringup")
    parser.add_argument("launch_file_name", help="trackway.launch.py")
    parser.add_argument("launch_arguments", nargs="*", metavar="name:=value", help="launch arguments")
    args = parser.parse_intermixed_args(argv)
    if (args.package_name, Path(args.launch_file_name).name) != (node_table.PACKAGE, node_table.LAUNCH_FILE):
        raise NotCovered(
            f"ros2 launch: only {node_table.PACKAGE} {node_table.LAUNCH_FILE} can be launched without a full ROS 2"
        )
    try:
        table = node_table.read_table(node_table.table_path())
        entries = node_table.selected(table, node_table.parse_arguments(args.launch_arguments))
    except InputError as error:
        raise Failure(f"ros2 launch: {error}") from None
    if args.show_args:
        print(describe(table))
        return 0
    note_shortage()
    return run_until_signalled(Group(processes(entries)))


def describe(table: node_table.NodeTable) -> str:
    """The launch arguments as ``--show-args`` prints them."""
    lines = ["Arguments (pass arguments as '<name>:=<value>'):"]
    for argument in table.arguments.values():
        valid = f" Valid choices are: {list(argument.choices)}" if argument.choices else ""
        lines += [
            "",
            f"    '{argument.name}':",
            f"        {argument.doc}.{valid}",
            f"        (default: '{argument.default_text}')",
        ]
    return "\n".join(lines)


def processes(entries: Sequence[node_table.NodeEntry]) -> list[Process]:
    """What to start, labelled ``executable-number`` as by the real launch; Failure if an executable is missing."""
    made = []
    for number, entry in enumerate(entries, start=1):
        path = executable(entry.package, entry.executable)
        made.append(Process(f"{entry.executable}-{number}", [str(path), *entry.ros_arguments()], entry.required))
    return made
