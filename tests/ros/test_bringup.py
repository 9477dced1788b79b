# SPDX-License-Identifier: Apache-2.0
"""Launch files, tested with fakes of the launch packages, and parameter files with the nodes."""

import atexit
import re
import runpy
import sys
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from click import UsageError
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from ema_cli.processes.bringup import NODES, node_class, parameter_file, program, ros_arguments
from ema_cli.processes.node_commands import NodeOptions, actuator_commands, monitor_commands
from ema_core.description import ActuatorDescription
from ema_monitor.calibration.calibration import Calibration
from ema_ros.rclpy_private import parameter_overrides
from ema_ros.topics import ACTUATOR_TOPICS, MONITOR_TOPICS, NODE_TOPICS, PLAYER_TOPICS

from ..packages import FOLDERS
from .spinning import ros_context

SHARE = Path(get_package_share_directory("ema_bringup"))


class Argument:
    def __init__(self, name: str, *, default_value: Any = None, description: str = "") -> None:
        self.name, self.default, self.description = name, default_value, description


class Configuration:
    """The value of a launch argument, resolved in a context."""

    def __init__(self, name: str) -> None:
        self.name = name

    def perform(self, context: dict[str, Any]) -> Any:
        return resolve(context[self.name], context)


def resolve(value: Any, context: dict[str, Any]) -> Any:
    if isinstance(value, Configuration):
        return value.perform(context)
    if isinstance(value, SimpleNamespace):
        return value.resolve(context)
    if isinstance(value, dict):
        return {key: resolve(item, context) for key, item in value.items()}
    return value


class Context(dict[str, Any]):
    """Values of the arguments, and the command line that they come from."""

    argv: tuple[str, ...] = ()


def later(function: Any) -> SimpleNamespace:
    return SimpleNamespace(resolve=function)


@pytest.fixture
def launch_modules(monkeypatch):
    contents = {
        "launch": {"LaunchDescription": list, "LaunchContext": Context},
        "launch.actions": {
            "DeclareLaunchArgument": Argument,
            "ExecuteProcess": lambda **options: {"name": "process", **options},
            "OpaqueFunction": lambda function: SimpleNamespace(function=function),
            "Shutdown": lambda reason: f"shutdown: {reason}",
        },
        "launch.substitutions": {"LaunchConfiguration": Configuration},
        "launch_ros": {},
        "launch_ros.actions": {"Node": lambda **options: options},
        "launch_ros.parameter_descriptions": {
            "ParameterValue": lambda value, value_type: later(
                lambda context: value_type(resolve(value, context))
            )
        },
    }
    monkeypatch.delitem(sys.modules, "ema_bringup.launch_arguments", raising=False)
    for name, attributes in contents.items():
        module = ModuleType(name)
        vars(module).update(attributes)
        monkeypatch.setitem(sys.modules, name, module)


def load(name: str) -> list[Any]:
    return runpy.run_path(str(SHARE / "launch" / name))["generate_launch_description"]()


def actions_of(name: str, **arguments: str) -> list[dict[str, Any]]:
    """Return the actions of a launch file with the given arguments."""
    actions = load(name)
    defaults = {item.name: item.default for item in actions if isinstance(item, Argument)}
    context = Context(defaults | arguments)
    context.argv = tuple(f"{key}:={value}" for key, value in arguments.items())
    return [
        {key: resolve(value, context) for key, value in started.items()}
        | {"parameters": [resolve(item, context) for item in started.get("parameters", ())]}
        for action in actions
        if not isinstance(action, Argument)
        for started in action.function(context)
    ]


def nodes_of(name: str, **arguments: str) -> dict[str, dict[str, Any]]:
    """Return the nodes of a launch file by name, with the namespace if the name is not unique."""
    nodes = [item for item in actions_of(name, **arguments) if "package" in item]
    names = [item["name"] for item in nodes]
    keys = [
        f"{n['namespace']}/{n['name']}" if names.count(n["name"]) > 1 else n["name"] for n in nodes
    ]
    return dict(zip(keys, nodes, strict=True))


def overrides_of(node: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters of a node that override its parameter file, without ``autostart``."""
    return {name: value for name, value in node["parameters"][-1].items() if name != "autostart"}


LAUNCH_FILES = {
    "ema.launch.py": {"bag": "worn"},
    "attach.launch.py": {},
    "bridge.launch.py": {},
    "robot.launch.py": {},
    "actuators.launch.py": {},
    "monitor.launch.py": {},
    "replay.launch.py": {"bag": "worn"},
}


@pytest.mark.usefixtures("launch_modules")
@pytest.mark.parametrize(("name", "arguments"), LAUNCH_FILES.items())
def test_launch_file_names_nodes_and_files_that_exist(name, arguments):
    nodes = nodes_of(name, **arguments)
    assert nodes
    for node in nodes.values():
        node_name = node["name"]
        assert (node["package"], node["executable"]) == NODES[node_name]
        assert Path(get_package_prefix(node["package"]), "lib", node["package"]).is_dir()
        assert program(node_name).is_file()
        file, *further, parameters = node["parameters"]
        assert Path(file) == parameter_file(node_name)
        assert all(Path(item).is_file() for item in further)
        assert node["namespace"] in ("/ema", "/ema/left", "/ema/right")
        undeclared = set(parameters) - set(declared(node_name)) - {"use_sim_time"}
        assert undeclared == set()


@pytest.mark.usefixtures("launch_modules")
@pytest.mark.parametrize(("name", "values"), LAUNCH_FILES.items())
def test_arguments_are_described_common_to_all_and_refused_when_unknown(name, values, monkeypatch):
    arguments = [item for item in load(name) if isinstance(item, Argument)]
    assert [item.name for item in arguments if not item.description] == []
    # All arguments have a default, except the bag to replay.
    assert {item.name for item in arguments if item.default is None} <= {"bag"}
    # `ros2 launch -s` prints a text plainly, but a substitution as an expression.
    assert {type(item.default) for item in arguments} <= {str, type(None)}
    files = [Path(item.default) for item in arguments if item.name.endswith("_params")]
    assert files
    assert all(file.is_file() for file in files)
    assert not any("parameter file" in (item.default or "") for item in arguments)
    common = {"log_level": "debug", "respawn": "true", "autostart": "false", "use_sim_time": "true"}
    for node in nodes_of(name, **values, **common).values():
        enclave = f"{node['namespace']}/{node['name']}"
        assert node["ros_arguments"] == ["--log-level", "debug", "--enclave", enclave]
        assert node["respawn"] == (node["name"] not in ("recorder", "player"))
        assert node["parameters"][-1]["autostart"] is False
        assert node["parameters"][-1]["use_sim_time"] is True
    with pytest.raises(RuntimeError, match="respawn:=maybe: expected true or false"):
        nodes_of(name, **values, respawn="maybe")
    names = {item.name for item in arguments}
    of_monitor = {"history_folder", "calibration_file", "monitor_params"}
    assert names & of_monitor == (set() if name == "robot.launch.py" else of_monitor)
    wrong = {**values, "respwn": "true"}
    nodes_of(name, **wrong)  # if another file includes this one, the argument may be for that file
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "ema_bringup", name])
    with pytest.raises(RuntimeError, match=r"has no argument respwn; arguments: .*respawn"):
        nodes_of(name, **wrong)


def test_rosbag2_uses_the_quality_of_service_of_each_topic_with_depth_1000():
    file = FOLDERS["ema_bringup"] / "config" / "record_qos.yaml"
    offered = ACTUATOR_TOPICS | MONITOR_TOPICS | PLAYER_TOPICS | NODE_TOPICS
    reported = yaml.safe_load(file.read_text(encoding="utf-8"))
    assert set(reported) == {f"/ema/{name}" for name in offered}
    for name, (_, qos) in offered.items():
        policies = reported[f"/ema/{name}"]
        # ros2bag reads the short keys of the policies.
        read = QoSProfile(
            history=HistoryPolicy.get_from_short_key(policies["history"]),
            depth=policies["depth"],
            reliability=ReliabilityPolicy.get_from_short_key(policies["reliability"]),
            durability=DurabilityPolicy.get_from_short_key(policies["durability"]),
        )
        assert (read.reliability, read.durability) == (qos.reliability, qos.durability), name
        assert read.depth >= max(qos.depth, 1000)


PLAYED = {
    **{"bag": "4711", "rate": 4.0, "actuator_only": True, "stay": False},
    **{"start_offset": 0.0, "playback_duration": 0.0, "loop": False},
}
PART = {"start_offset": "2", "playback_duration": "1.5", "loop": "true"}
FOUR = {"bag": "4711", "rate": "4"}


@pytest.mark.usefixtures("launch_modules")
@pytest.mark.parametrize(
    ("file", "arguments", "node", "expected"),
    [
        ("ema", {"bag": "worn"}, "recorder", {"output": "worn"}),
        ("replay", FOUR, "monitor", {"use_sim_time": True}),
        ("replay", FOUR, "player", PLAYED),
        (
            *("replay", FOUR | PART, "player"),
            PLAYED | {"start_offset": 2.0, "playback_duration": 1.5, "loop": True},
        ),
        ("replay", FOUR | {"end": "false"}, "player", PLAYED | {"stay": True}),
        ("attach", {"accept_after": "5"}, "monitor", {"accept_after": 5}),
        ("attach", {}, "recorder", {"output": "recordings"}),
        # Without calibrations, the built-in calibration must fit the units.
        ("actuators", {}, "/ema/left/actuator", {"actuator_id": "left", "seed": 0}),
        ("actuators", {}, "/ema/right/actuator", {"actuator_id": "right", "seed": 1}),
        (
            *("actuators", {"calibration_file": "/c/{actuator_id}.yaml"}, "/ema/right/actuator"),
            {"actuator_id": "right", "serial_number": "SIM-right", "seed": 1},
        ),
    ],
)
def test_arguments_become_parameters(file: str, arguments: dict, node: str, expected: dict):
    assert overrides_of(nodes_of(f"{file}.launch.py", **arguments)[node]) == expected


@pytest.mark.usefixtures("launch_modules")
@pytest.mark.parametrize(
    ("file", "arguments", "reported"),
    [
        ("ema", {"actuator_params": "no.yaml"}, r"actuator_params:=no\.yaml: no such"),
        ("actuators", {"monitors": "2", "monitor_params": "no.yaml"}, r"monitor_params:=no\.yaml"),
        ("actuators", {"actuators": "a,a"}, "expected distinct names"),
        ("actuators", {"monitors": "0"}, "monitors:=0: expected an integer"),
        ("monitor", {"monitors": "two"}, "monitors:=two: expected an integer"),
        ("replay", {"bag": "worn", "rate": "fast"}, "rate:=fast: expected a number"),
    ],
)
def test_impossible_argument_is_refused_by_name(file: str, arguments: dict, reported: str):
    with pytest.raises(RuntimeError, match=reported):
        nodes_of(f"{file}.launch.py", **arguments)


@pytest.mark.usefixtures("launch_modules")
def test_recorder_is_launched_when_a_bag_is_named_and_ends_all_when_it_fails():
    assert set(nodes_of("ema.launch.py")) == {"actuator", "monitor", "dashboard"}
    recorder = nodes_of("ema.launch.py", bag="worn")["recorder"]
    assert recorder["on_exit"] == "shutdown: the recorder has ended"


@pytest.mark.usefixtures("launch_modules")
def test_parameter_file_can_be_replaced(tmp_path):
    file = str(tmp_path / "own.yaml")
    Path(file).touch()
    nodes = nodes_of("ema.launch.py", namespace="/left", actuator_params=file)
    assert nodes["actuator"]["parameters"][0] == file
    assert {node["namespace"] for node in nodes.values()} == {"/left"}


@pytest.mark.usefixtures("launch_modules")
def test_actuators_publish_on_the_topics_of_one_monitor():
    nodes = nodes_of("actuators.launch.py", calibration_file="/c/{actuator_id}.yaml")
    assert overrides_of(nodes["monitor"])["calibration_file"] == "/c/{actuator_id}.yaml"
    remapped = dict(nodes["/ema/left/actuator"]["remappings"])
    assert remapped["telemetry"] == "/ema/telemetry"
    assert set(remapped) == set(ACTUATOR_TOPICS)
    assert Calibration.builtin().serial_number == ActuatorDescription().serial_number


@pytest.mark.usefixtures("launch_modules")
@pytest.mark.parametrize("name", ["actuators.launch.py", "monitor.launch.py"])
def test_each_monitor_of_several_has_a_name_a_shard_and_a_file(name, tmp_path, monkeypatch):
    at_exit = []
    monkeypatch.setattr(
        atexit, "register", lambda *call, **options: at_exit.append((call, options))
    )
    file = tmp_path / "own.yaml"
    file.write_text(SHARED_FILE)
    nodes = nodes_of(name, monitors="2", monitor_params=str(file), history_folder="kept")
    first, second = (nodes[f"monitor_{index}"] for index in range(2))
    shared = {"history_folder": "kept", "shard.count": 2}
    if name == "actuators.launch.py":
        shared["actuators"] = ["left", "right"]
    assert overrides_of(first) == {**shared, "shard.index": 0}
    assert overrides_of(second) == {**shared, "shard.index": 1}
    assert first["executable"] == second["executable"] == "monitor_node"
    for node, budget in ((first, 700), (second, 900)):
        arguments = ["--ros-args", "--params-file", str(node["parameters"][0])]
        arguments += ["-r", "__ns:=/ema", "-r", f"__node:={node['name']}"]
        values, overrides = started("monitor", *arguments)
        assert overrides - values.keys() == set()
        assert (values["budget"], values["limits.gain"], values["window_s"]) == (budget, 0.2, 0.4)
    for (remove, *arguments), options in at_exit:
        remove(*arguments, **options)
    assert not Path(first["parameters"][0]).parent.exists()


SHARED_FILE = """
/**/monitor_1:
  ros__parameters:
    budget: 900
/**/monitor:
  ros__parameters:
    budget: 700
    limits: {gain: 0.2}
ema:
  monitor:
    ros__parameters:
      window_s: 0.4
/**/actuator:
  ros__parameters:
    seed: 1
"""


def test_commands_of_many_actuators_and_monitors_name_each(tmp_path):
    common = NodeOptions([parameter_file("simulated")], ["history_folder:=kept"], "/wing")
    monitors = monitor_commands(2, common, tmp_path, ["left", "right"])
    assert list(monitors) == ["monitor_0", "monitor_1"]
    values, _ = started("monitor", *monitors["monitor_1"][1:])
    shard = (values["shard.index"], values["shard.count"])
    assert (values["history_folder"], shard) == ("kept", (1, 2))
    assert values["actuators"] == ["left", "right"]
    named = ["-r", "__node:=monitor_1", "--enclave", "/wing/monitor_1"]
    assert monitors["monitor_1"][-4:] == named
    actuators = actuator_commands(["left", "right"], common)
    values, _ = started("actuator", *actuators["actuator right"][1:])
    assert (values["actuator_id"], values["seed"]) == ("right", 1)
    assert "telemetry:=/wing/telemetry" in actuators["actuator right"]
    assert "__ns:=/wing/right" in actuators["actuator right"]
    with pytest.raises(UsageError, match="expected distinct names"):
        actuator_commands(["a", "a"], common)
    with pytest.raises(ValueError, match="--actuators 'left wing': expected letters"):
        actuator_commands(["left wing"], common)


def test_parameter_file_of_the_user_overrides_the_simulated_monitors(tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text("/**/monitor:\n  ros__parameters:\n    history_folder: kept\n")
    simulated = parameter_file("simulated")
    for files, folder in (([simulated], "memory"), ([simulated, file], "kept")):
        values, overrides = started("monitor", *ros_arguments("monitor", parameter_files=files))
        assert overrides - values.keys() == set()
        assert values["history_folder"] == folder
    arguments = ros_arguments(
        "monitor", parameter_files=[simulated], assignments=["history_folder:=kept"]
    )
    assert started("monitor", *arguments)[0]["history_folder"] == "kept"


@pytest.mark.usefixtures("launch_modules")
def test_replay_shows_the_diagnosis_and_ends_with_it():
    [shown] = [item for item in actions_of("replay.launch.py", bag="worn") if "cmd" in item]
    context = Context()
    program, *arguments = [resolve(item, context) for item in shown["cmd"]]
    assert Path(program).is_file()
    assert arguments == ["watch", "--namespace", "/ema", "--until-played"]
    assert shown["on_exit"] == "shutdown: the diagnosis is complete"
    [shown] = [i for i in actions_of("replay.launch.py", bag="worn", end="false") if "cmd" in i]
    assert "--until-played" not in shown["cmd"]
    assert "on_exit" not in shown


def started(node_name: str, *arguments: str) -> Any:
    """Return the parameter values of an unconfigured node, and the names of given parameters."""
    with ros_context(arguments=list(arguments)) as context:
        node = node_class(node_name)(context=context)
        values = {name: item.value for name, item in node._parameters.items()}
        overrides = set(parameter_overrides(node))
        node.destroy_node()
    return values, overrides


@cache
def declared(node_name: str) -> dict[str, Any]:
    return started(node_name)[0]


@pytest.mark.parametrize("node_name", NODES)
def test_parameter_file_names_declared_parameters_at_their_defaults(node_name):
    values, overrides = started(node_name, *ros_arguments(node_name))
    assert overrides
    assert overrides - values.keys() == set()
    assert values == declared(node_name)


def test_demo_makes_the_actuator_wear_out():
    files = [parameter_file("demo")]
    values, overrides = started("actuator", *ros_arguments("actuator", parameter_files=files))
    assert overrides - values.keys() == set()
    assert values["growth.friction.law"] == "exponential"
    # The seed of the demo overrides the seed of the default file.
    assert (declared("actuator")["seed"], values["seed"]) == (0, 1)


def test_demo_makes_two_joints_of_the_robot_wear():
    files = [parameter_file("demo_robot")]
    values, overrides = started("robot", *ros_arguments("robot", parameter_files=files))
    assert overrides - values.keys() == set()
    wear = {name: value for name, value in values.items() if name.startswith("wear.") and value}
    assert wear == {"wear.elbow": 0.03, "wear.wrist_2": 0.015}


def test_aggregator_sorts_every_status():
    [node] = yaml.safe_load(parameter_file("aggregator").read_text()).values()
    analyzers = node["ros__parameters"]["ema"]["analyzers"]
    patterns = {name: analyzer["regex"] for name, analyzer in analyzers.items()}
    groups = {
        status: [
            name
            for name, regexes in patterns.items()
            if any(re.fullmatch(regex, f"/ema/{status}") for regex in regexes)
        ]
        for status in (
            *("monitor: flap health", "monitor_1: flap short circuit A", "monitor: unit 7 history"),
            *("monitor_1: lifecycle", "recorder: recording", "left/actuator: simulation"),
        )
    }
    assert list(groups.values()) == [*[["actuators"]] * 3, *[["nodes"]] * 3]
