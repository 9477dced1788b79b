# SPDX-License-Identifier: Apache-2.0
"""Diagnosis of a recording: its actuator topics are played to a monitor, and the results shown.

ros2 launch ema_bringup replay.launch.py bag:=worn_flap rate:=4.0

Each change of a level is printed as a line. All nodes end when the bag is played and its last
window is diagnosed, unless `end:=false` keeps the dashboard.
"""

from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_prefix
from launch.actions import ExecuteProcess, Shutdown

from ema_bringup import launch_arguments as ema
from launch import LaunchContext, LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Return the launch description with the nodes and their arguments."""
    return ema.launch(
        __file__,
        _nodes,
        ("player", "monitor", "dashboard"),
        bag=(None, "bag to play: a file or a folder"),
        rate=("1.0", "playback rate"),
        start_offset=("0.0", "start of the playback, relative to the start of the bag [s]"),
        playback_duration=("0.0", "duration of the playback; 0: to the end of the bag [s]"),
        loop=("false", "true: restart at the end"),
        end=("true", "false: keep running when the diagnosis is complete"),
    )


def _nodes(context: LaunchContext) -> list[Any]:
    played: dict[str, Any] = {"bag": ema.value_of(context, "bag")}
    for name in ("rate", "start_offset", "playback_duration"):
        value = ema.value_of(context, name)
        try:
            played[name] = float(value)
        except ValueError as error:
            raise RuntimeError(f"{name}:={value}: expected a number") from error
    played["loop"] = ema.flag_of(context, "loop")
    ends = ema.flag_of(context, "end")
    command = [
        str(Path(get_package_prefix("ema_cli"), "lib", "ema_cli", "ema")),
        *("watch", "--namespace", ema.value_of(context, "namespace")),
        *(["--until-played"] if ends else []),
    ]
    done = {"on_exit": Shutdown(reason="the diagnosis is complete")} if ends else {}
    return [
        # The monitor uses the time of the recording, even if other nodes do not.
        *ema.monitors(context, use_sim_time=True),
        ema.node(context, "dashboard", "ema_dashboard"),
        ExecuteProcess(cmd=command, output="screen", **done),
        ema.node(
            context,
            "player",
            "ema_bags",
            parameters={**played, "actuator_only": True, "stay": not ends},
            respawns=False,
        ),
    ]
