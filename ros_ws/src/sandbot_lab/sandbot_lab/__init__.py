"""The virtual lab: a time-domain ground truth that stands in for robot, bed and cameras."""
