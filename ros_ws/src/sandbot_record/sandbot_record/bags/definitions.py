"""The topic of each channel of a storage file, and how its messages are encoded."""

from dataclasses import dataclass, field, replace

from mcap.records import Channel, Schema

from sandbot_record.bags import metadata
from sandbot_record.bags.interfaces import JAZZY, Interface


@dataclass
class Definitions:
    """Topics and schemas of one file by id; types that the file does not define are those of ``release``."""

    release: str = JAZZY
    topics: dict[int, metadata.TopicInfo] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)

    def learn(self, record: Schema | Channel) -> None:
        """Add a schema or channel record; of several with one id the first is kept."""
        if isinstance(record, Schema):
            self.schemas.setdefault(record.id, record)
            return
        schema = self.schemas.get(record.schema_id)
        if schema is None and record.schema_id:
            return  # a summary may repeat channels without their schemas, which then come later
        topic = self.topics.setdefault(record.id, self._topic(record, schema))
        # A topic known from metadata.yaml still lacks its definition.
        if topic.interface.schema is None and schema is not None and _full_name(schema.name) == topic.type:
            self.topics[record.id] = replace(topic, interface=replace(topic.interface, schema=schema))

    def _topic(self, record: Channel, schema: Schema | None) -> metadata.TopicInfo:
        interface = Interface(
            _full_name(schema.name) if schema else "",
            hash=record.metadata.get("topic_type_hash", ""),
            encoding=record.message_encoding,
            schema=schema,
            release=self.release,
        )
        qos = metadata.qos_from_text(record.metadata.get("offered_qos_profiles", ""))
        return metadata.TopicInfo(record.topic, interface, qos)


def _full_name(name: str) -> str:
    """``sensor_msgs/JointState`` as ``sensor_msgs/msg/JointState``."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name
