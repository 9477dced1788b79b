# SPDX-License-Identifier: Apache-2.0
"""Entry points of the nodes and of ``ema``; Ctrl-C during imports prints no traceback."""

from ema_core.start import program

actuator_node = program("ema_sim.actuator_node")
bridge_node = program("ema_bags.inputs.bridge_node")
dashboard_node = program("ema_dashboard.dashboard_node")
ema = program("ema_cli.main")
monitor_node = program("ema_monitor.node.monitor_node")
player_node = program("ema_bags.player_node")
recorder_node = program("ema_bags.recorder_node")
robot_node = program("ema_sim.robot_node")
