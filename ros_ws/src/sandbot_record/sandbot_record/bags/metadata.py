"""metadata.yaml of a bag folder: rosbag2 version 9, as `ros2 bag` of Jazzy and rosbags read it.

It is written when recording starts and again when a topic appears, so that types, QoS and hashes survive any damage to
the .mcap file, and completed at the end; ``custom_data: state`` is "recording" until then and "complete" after.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos

from sandbot_common import files, yaml_text
from sandbot_common.errors import InputError
from sandbot_record.bags.interfaces import CDR, JAZZY, Interface, has_release

NAME = "metadata.yaml"
RECORDING, COMPLETE = "recording", "complete"
_VERSION = 9
_NEWEST_VERSIONS = {"humble": 6, "iron": 8}
"""Version of metadata.yaml in these releases. Foxy and Galactic write older ones, and define types as Humble does."""
INFINITE = QosTime(9223372036, 854775807)


def qos(*, latched: bool = False, depth: int = 50, reliable: bool = True) -> Qos:
    """The QoS profile of a topic, as rosbag2 stores it."""
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=INFINITE,
        lifespan=INFINITE,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=INFINITE,
        avoid_ros_namespace_conventions=False,
    )


def qos_text(profiles: Sequence[Qos]) -> str:
    """QoS profiles as YAML text for an MCAP channel; the same content as in metadata.yaml."""
    return yaml_text.dump_yaml(dump_qos_v9(list(profiles))) if profiles else ""


@lru_cache(maxsize=256)
def qos_from_text(text: str) -> tuple[Qos, ...]:
    """QoS profiles from the text of ``qos_text``; empty if it can't be parsed."""
    try:
        return tuple(parse_qos(yaml_text.load_yaml(text) or []))
    except (yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError):
        return ()


@dataclass
class TopicInfo:
    """One topic of a bag."""

    name: str
    interface: Interface
    qos: tuple[Qos, ...] = ()
    count: int = 0

    @property
    def type(self) -> str:
        """Name of the message type."""
        return self.interface.type


@dataclass
class FileInfo:
    """One storage file of a bag; times in ns."""

    path: str
    start_ns: int = 0
    end_ns: int = 0
    count: int = 0


@dataclass
class BagInfo:
    """What metadata.yaml says."""

    topics: list[TopicInfo] = field(default_factory=list)
    files: list[FileInfo] = field(default_factory=list)
    custom: dict[str, str] = field(default_factory=dict)
    storage: str = "mcap"
    compression: str = ""
    distro: str = JAZZY
    version: int = _VERSION

    @property
    def release(self) -> str:
        """The ROS 2 release whose types apply where a file defines none: the one that wrote the bag, inferred from the
        version of metadata.yaml where it is not named (before version 8, or in bags not written by ROS).
        """
        if has_release(self.distro):
            return self.distro
        return next((name for name, newest in _NEWEST_VERSIONS.items() if self.version <= newest), JAZZY)

    @property
    def count(self) -> int:
        """Messages in all topics."""
        return sum(topic.count for topic in self.topics)


def write(folder: Path, info: BagInfo) -> None:
    """Write metadata.yaml atomically."""
    spans = [(file.start_ns, file.end_ns) for file in info.files if file.count]
    start, end = (min(s for s, _ in spans), max(e for _, e in spans)) if spans else (0, 0)
    content = {
        "rosbag2_bagfile_information": {
            "version": _VERSION,
            "storage_identifier": info.storage,
            "duration": {"nanoseconds": end - start},
            "starting_time": {"nanoseconds_since_epoch": start},
            "message_count": info.count,
            "topics_with_message_count": [_topic(topic) for topic in info.topics],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file.path for file in info.files],
            "files": [
                {
                    "path": file.path,
                    "starting_time": {"nanoseconds_since_epoch": file.start_ns},
                    "duration": {"nanoseconds": file.end_ns - file.start_ns},
                    "message_count": file.count,
                }
                for file in info.files
            ],
            "custom_data": dict(info.custom) or None,
            "ros_distro": info.distro,
        }
    }
    files.write_text(folder / NAME, yaml_text.dump_yaml(content))


def read(folder: Path) -> BagInfo | None:
    """Contents of metadata.yaml; None if there is no such file. Raises InputError if it is not rosbag2's."""
    path = folder / NAME
    if not path.exists():
        return None
    content = yaml_text.read_yaml(path).get("rosbag2_bagfile_information")
    try:
        return _parse(content)  # type: ignore[arg-type]
    except KeyError as error:
        raise InputError(f"{path}: missing key {error}: not a rosbag2 metadata.yaml") from None
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"{path}: not a rosbag2 metadata.yaml ({error})") from None


def _parse(content: Mapping[str, Any]) -> BagInfo:
    paths = [str(path) for path in content["relative_file_paths"]]
    given = {str(entry["path"]): _file(entry) for entry in content.get("files") or []}
    info = BagInfo(
        files=[given.get(path, FileInfo(path)) for path in paths],
        custom={str(key): str(value) for key, value in (content.get("custom_data") or {}).items()},
        storage=str(content["storage_identifier"]),
        compression=str(content.get("compression_mode") or "").lower().replace("none", ""),
        distro=str(content.get("ros_distro", "")),
        version=int(content.get("version", _VERSION)),
    )
    info.topics = [_topic_of(entry, info.release) for entry in content["topics_with_message_count"]]
    return info


def _topic_of(entry: Mapping[str, Any], release: str) -> TopicInfo:
    topic = entry["topic_metadata"]
    interface = Interface(
        str(topic["type"]),
        hash=str(topic.get("type_description_hash", "")),
        encoding=str(topic.get("serialization_format", CDR)),
        release=release,
    )
    return TopicInfo(
        str(topic["name"]), interface, _qos(topic.get("offered_qos_profiles", [])), int(entry["message_count"])
    )


def _file(entry: Mapping[str, Any]) -> FileInfo:
    start = int(entry["starting_time"]["nanoseconds_since_epoch"])
    end = start + int(entry["duration"]["nanoseconds"])
    return FileInfo(str(entry["path"]), start, end, int(entry["message_count"]))


def _qos(value: object) -> tuple[Qos, ...]:
    if isinstance(value, str):
        return qos_from_text(value)
    try:
        return tuple(parse_qos(value))  # type: ignore[arg-type]
    except (KeyError, TypeError, ValueError, AttributeError):
        return ()


def _topic(topic: TopicInfo) -> dict[str, object]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type,
            "serialization_format": topic.interface.encoding,
            "offered_qos_profiles": dump_qos_v9(list(topic.qos)),
            "type_description_hash": topic.interface.hash,
        },
        "message_count": topic.count,
    }
