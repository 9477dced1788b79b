"""Monitor node: the only part of the monitor that imports ROS."""
