"""MCAP bags in and out, and the trials table made from them.

    import sandbot_record
    for stamp_ns, message in sandbot_record.read("runs/demo/trials/t0001", "/speed"):
        print(stamp_ns, message.decode().twist.twist.linear.x)
    sandbot_record.read_trials("runs/demo").to_frame()

bags/             (knows nothing of trials)
  reader          read, Bag: topics, counts, provenance and messages of an intact or truncated bag
  columns         equal-length messages of one topic as numpy columns
  writer          BagWriter: a bag folder, written atomically or recoverably
  recording       the recorder without ROS: queue, writer thread, split, free space, counts
  playback        the replay without ROS: order, pace, pause, seek, loop
  recover         copies everything intact in a truncated or damaged bag to a new, complete one
  frames, video   images: pixels of a raw message, JPEG messages, frames in a video file
  interfaces      message types: definition, type hash, decoding (rosbags' type store; no ROS needed)
  definitions     which channel of a file is which topic
  metadata        metadata.yaml (rosbag2 version 9)
  mcap_writer, mcap_scan   one .mcap file: written in chunks that survive a crash; read block by block
  file_bytes      the bytes of a file; one that is lost meanwhile is an error
  foreign         bags of other storages and encodings, read through rosbags; translate: messages of other releases
trials/
  read            read_trials: one table from a campaign folder, bags or CSV files
  table           Trials: one row per trial; columns: what they hold; order, copies, gaits: of its rows
  same_trials     trials that two tables share; agreement: in the digits that both give
  csv_table       from and to CSV; header: which column a name means, in which unit; frame: from pandas
  setting         what all trials share: robot, frame rate, accuracy
  from_bags       one bag to one row; a campaign to a table, in parallel; cache: so that no bag is read twice
  judge           whether a trial went as planned; publishers: whether it alone published; legs: by name
  camera_reports  whether the tracker trusted its cameras
  film            kept frames with the tracked marks drawn on them; film_strip: a few of them
nodes/            recorder_node and replay_node connect them to ROS
tools/            record, replay, recover, info, table
"""

from typing import TYPE_CHECKING

from sandbot_common.lazy import attach

if TYPE_CHECKING:
    from sandbot_record.bags.reader import Bag, read
    from sandbot_record.bags.writer import BagWriter
    from sandbot_record.trials.read import read as read_trials
    from sandbot_record.trials.table import Trials

__all__ = ("Bag", "BagWriter", "Trials", "read", "read_trials")

_MODULES = {
    "read": ".bags.reader",
    "Bag": ".bags.reader",
    "BagWriter": ".bags.writer",
    "read_trials": ".trials.read:read",
    "Trials": ".trials.table",
}
__getattr__, __dir__ = attach(__name__, _MODULES)
