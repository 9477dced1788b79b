# SPDX-License-Identifier: Apache-2.0
"""Monitor node: the only part of the monitor that imports ROS."""
