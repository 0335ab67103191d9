"""Start the trackway: ``ros2 launch sandbot_bringup trackway.launch.py [name:=value ...]`` (config/nodes.yaml)."""

import sys
from pathlib import Path

from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription
from sandbot_bringup import node_table
from sandbot_common.ros.node import END_WITH_PARENT
from sandbot_common.shared_memory import note_shortage


def generate_launch_description() -> LaunchDescription:
    """The launch arguments of the node table, and its nodes once their values are known."""
    table = node_table.read_table(node_table.table_path())
    declared = [
        DeclareLaunchArgument(
            argument.name,
            default_value=argument.default_text,
            description=argument.doc,
            choices=list(argument.choices) or None,
        )
        for argument in table.arguments.values()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start, args=[table])])


def start(context: LaunchContext, table: node_table.NodeTable) -> list[Node]:
    """One action per node; when a required one ends, everything stops."""
    note_shortage()
    # Besides the declared arguments, launch keeps every other name:=value it was given, such as bed.pulse_off_s.
    given = {name: value for name, value in context.launch_configurations.items() if _ours(name, table)}
    if any(Path(word).name == node_table.LAUNCH_FILE for word in sys.argv):
        # Typed for this file: an unknown name, which launch itself would silently keep, is refused.
        given |= node_table.parse_arguments(context.argv)
    return [
        Node(
            package=entry.package,
            executable=entry.executable,
            name=entry.name,
            namespace=entry.namespace or None,
            parameters=[entry.parameters] if entry.parameters else None,
            output="screen",
            additional_env={END_WITH_PARENT: "1"},
            on_exit=[Shutdown(reason=f"{entry.name} has ended")] if entry.required else None,
        )
        for entry in node_table.selected(table, given)
    ]


def _ours(name: str, table: node_table.NodeTable) -> bool:
    return name in table.arguments or name.partition(".")[0] in {entry.name for entry in table.nodes}
