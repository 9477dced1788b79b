"""Environment of all tests: ROS nodes of a test see no other nodes, and messages check fields."""

import os
import tempfile

# Domains above 101 use ports that Linux hands out to other programs.
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 101)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
# Otherwise an int in a float64 field is sent as another number, without a word.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
# Histories and calibrations of the user stay as they are.
os.environ["ROS_HOME"] = tempfile.mkdtemp(prefix="ema_ros_home_")
