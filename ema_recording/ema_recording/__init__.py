"""Reads and writes recordings as rosbag2 does, in MCAP."""
