"""Which channel of a storage file is which topic, and the definition text of each type."""

from dataclasses import dataclass, field

from mcap.records import Channel, Schema

from sandbot_record.bags import metadata


@dataclass
class Definitions:
    """Of one file: topics and schemas by their ids."""

    topics: dict[int, metadata.TopicInfo] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    encodings: dict[int, str] = field(default_factory=dict)

    def learn(self, record: Schema | Channel) -> None:
        """Take a schema or channel record; the first of an id is kept."""
        if isinstance(record, Schema):
            self.schemas.setdefault(record.id, record)
        elif record.id not in self.topics:
            schema = self.schemas.get(record.schema_id)
            self.encodings[record.id] = record.message_encoding
            self.topics[record.id] = metadata.TopicInfo(
                name=record.topic,
                type=_full_name(schema.name) if schema else "",
                hash=record.metadata.get("topic_type_hash", ""),
                qos=metadata.qos_from_text(record.metadata.get("offered_qos_profiles", "")),
            )


def _full_name(name: str) -> str:
    """``sensor_msgs/JointState`` as ``sensor_msgs/msg/JointState``."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name
