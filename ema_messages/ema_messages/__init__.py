"""Conversions between numerics and ROS messages."""
