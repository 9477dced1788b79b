# SPDX-License-Identifier: Apache-2.0
"""Dashboard: serves the ROS graph to Foxglove and to a built-in web page."""
