"""MCAP bags in and out, and the trials table made from them.

interfaces     message types: definition, type hash, decoding (rosbags' type store; no ROS needed)
mcap_writer    one .mcap file: chunks that survive a crash
mcap_scan      one .mcap file, whole or damaged, block by block
metadata       metadata.yaml (rosbag2 version 9)
writer         BagWriter: a bag folder, written whole or recoverable
reader         Bag: topics, counts, provenance, messages, whole or torn
columns        equal-length messages of one topic as numpy columns
recover        a torn or damaged bag into a new whole one
trials         the trials table: Trials, read(DATA), CSV in and out
table          one bag to one row; a campaign to a table, in parallel, cached
frames         images: pixels of a raw message, JPEG messages
video          frames in a video file, and the topic that says which is when
recording      the recorder without ROS: queue, writer thread, split, free space, counts
playback       the replay without ROS: order, pace, pause, seek, loop
recorder_node, replay_node   their wiring to ROS
tools/         record, replay, recover, info, table
"""
