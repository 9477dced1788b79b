"""Launch files against stand-ins for the launch packages, parameter files against the nodes."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory

from ema_cli.processes.bringup import NODES, parameter_file, program, ros_arguments
from ema_dashboard.dashboard_node import DashboardNode
from ema_inputs.bridge_node import BridgeNode
from ema_monitor.node.monitor_node import MonitorNode
from ema_recording.player_node import PlayerNode
from ema_recording.recorder_node import RecorderNode
from ema_ros.rclpy_private import given_parameters
from ema_sim.actuator_node import ActuatorNode

from .spinning import ros_context

SHARE = Path(get_package_share_directory("ema_bringup"))
CLASSES = {
    "actuator": ActuatorNode,
    "bridge": BridgeNode,
    "dashboard": DashboardNode,
    "monitor": MonitorNode,
    "recorder": RecorderNode,
    "player": PlayerNode,
}


class Argument:
    def __init__(self, name: str, *, default_value: Any = None, description: str = "") -> None:
        self.name, self.default, self.description = name, default_value, description


class Configuration:
    """The value of a launch argument, once there is a context."""

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


def later(function: Any) -> SimpleNamespace:
    return SimpleNamespace(resolve=function)


@pytest.fixture
def launch_modules(monkeypatch):
    contents = {
        "launch": {"LaunchDescription": list, "LaunchContext": dict},
        "launch.actions": {
            "DeclareLaunchArgument": Argument,
            "OpaqueFunction": lambda function: SimpleNamespace(function=function),
        },
        "launch.conditions": {"IfCondition": lambda predicate: predicate},
        "launch.substitutions": {
            "LaunchConfiguration": Configuration,
            "NotEqualsSubstitution": lambda a, b: later(
                lambda context: resolve(a, context) != resolve(b, context)
            ),
            "PathJoinSubstitution": lambda parts: later(
                lambda context: str(Path(*(resolve(part, context) for part in parts)))
            ),
        },
        "launch_ros": {},
        "launch_ros.actions": {"Node": lambda **options: options},
        "launch_ros.parameter_descriptions": {
            "ParameterValue": lambda value, value_type: later(
                lambda context: value_type(resolve(value, context))
            )
        },
        "launch_ros.substitutions": {
            "FindPackageShare": lambda package: get_package_share_directory(package)
        },
    }
    for name, attributes in contents.items():
        module = ModuleType(name)
        vars(module).update(attributes)
        monkeypatch.setitem(sys.modules, name, module)


def load(name: str) -> list[Any]:
    return runpy.run_path(str(SHARE / "launch" / name))["generate_launch_description"]()


def nodes_of(name: str, **given: str) -> dict[str, dict[str, Any]]:
    """Return the nodes that a launch file starts with some arguments given."""
    actions = load(name)
    context = {item.name: item.default for item in actions if isinstance(item, Argument)} | given
    nodes: dict[str, dict[str, Any]] = {}
    for action in actions:
        if isinstance(action, Argument):
            continue
        for node in [action] if isinstance(action, dict) else action.function(context):
            if "condition" in node and not resolve(node["condition"], context):
                continue
            nodes[node["name"]] = {
                **node,
                "namespace": resolve(node["namespace"], context),
                "parameters": [resolve(item, context) for item in node["parameters"]],
            }
    return nodes


LAUNCH_FILES = {
    "ema.launch.py": {"bag": "worn"},
    "bridge.launch.py": {},
    "monitor.launch.py": {},
    "replay.launch.py": {"bag": "worn"},
}


@pytest.mark.usefixtures("launch_modules")
@pytest.mark.parametrize(("name", "given"), LAUNCH_FILES.items())
def test_launch_file_names_nodes_and_files_that_exist(name, given):
    nodes = nodes_of(name, **given)
    assert nodes
    for node_name, node in nodes.items():
        assert (node["package"], node["executable"]) == NODES[node_name]
        assert Path(get_package_prefix(node["package"]), "lib", node["package"]).is_dir()
        assert program(node_name).is_file()
        file, *own = node["parameters"]
        assert Path(file) == parameter_file(node_name)
        assert node["namespace"] == "/ema"
        undeclared = set().union(*own) - set(declared(node_name)) - {"use_sim_time"}
        assert undeclared == set()


@pytest.mark.usefixtures("launch_modules")
@pytest.mark.parametrize("name", LAUNCH_FILES)
def test_launch_arguments_are_described(name):
    arguments = [item for item in load(name) if isinstance(item, Argument)]
    assert arguments
    assert [item.name for item in arguments if not item.description] == []
    # Whatever is listed has a default, except a bag that must be named to be replayed.
    assert {item.name for item in arguments if item.default is None} <= {"bag"}


@pytest.mark.usefixtures("launch_modules")
def test_recorder_is_launched_when_a_bag_is_named():
    assert set(nodes_of("ema.launch.py")) == {"actuator", "monitor", "dashboard"}
    recorder = nodes_of("ema.launch.py", bag="worn")["recorder"]
    assert recorder["parameters"][1] == {"output": "worn"}
    nodes = nodes_of("ema.launch.py", namespace="/left", actuator_params="own.yaml")
    assert nodes["actuator"]["parameters"] == ["own.yaml"]
    assert {node["namespace"] for node in nodes.values()} == {"/left"}


@pytest.mark.usefixtures("launch_modules")
def test_history_beside_the_simulated_actuator_is_in_memory_unless_a_folder_is_named():
    assert nodes_of("ema.launch.py")["monitor"]["parameters"][1] == {"history_folder": ""}
    nodes = nodes_of("ema.launch.py", history_folder="kept")
    assert nodes["monitor"]["parameters"][1] == {"history_folder": "kept"}
    [monitor] = nodes_of("monitor.launch.py").values()
    assert len(monitor["parameters"]) == 1


def test_own_parameter_file_overrides_that_of_the_simulated_actuators_monitor(tmp_path):
    own = tmp_path / "own.yaml"
    own.write_text("/**/monitor:\n  ros__parameters:\n    history_folder: kept\n")
    simulated = parameter_file("simulated")
    for files, folder in (([simulated], ""), ([simulated, own], "kept")):
        values, given = started("monitor", *ros_arguments("monitor", parameter_files=files))
        assert given - values.keys() == set()
        assert values["history_folder"] == folder
    arguments = ros_arguments(
        "monitor", parameter_files=[simulated], assignments=["history_folder:=kept"]
    )
    assert started("monitor", *arguments)[0]["history_folder"] == "kept"


@pytest.mark.usefixtures("launch_modules")
def test_files_of_ones_own_actuator_override_the_parameter_file_only_when_given():
    [monitor] = nodes_of("monitor.launch.py", params_file="own.yaml").values()
    assert monitor["parameters"] == ["own.yaml"]
    [monitor] = nodes_of("monitor.launch.py", calibration_file="c.yaml").values()
    assert monitor["parameters"][1:] == [{"calibration_file": "c.yaml"}]


@pytest.mark.usefixtures("launch_modules")
def test_replay_runs_in_simulated_time_and_plays_the_actuator_only():
    nodes = nodes_of("replay.launch.py", bag="worn", rate="4")
    assert nodes["monitor"]["parameters"][1] == {"use_sim_time": True}
    assert nodes["player"]["parameters"][1] == {"bag": "worn", "rate": 4.0, "actuator_only": True}


def started(node_name: str, *arguments: str) -> Any:
    """Return a node, not yet configured, and destroy what it takes to have it."""
    with ros_context(arguments=list(arguments)) as context:
        node = CLASSES[node_name](context=context)
        values = {name: item.value for name, item in node._parameters.items()}
        given = set(given_parameters(node))
        node.destroy_node()
    return values, given


def declared(node_name: str) -> dict[str, Any]:
    return started(node_name)[0]


@pytest.mark.parametrize("node_name", NODES)
def test_parameter_file_names_declared_parameters_at_their_defaults(node_name):
    values, given = started(node_name, *ros_arguments(node_name))
    assert given
    assert given - values.keys() == set()
    assert values == declared(node_name)


@pytest.mark.parametrize("node_name", NODES)
def test_parameter_file_holds_in_any_namespace(node_name):
    assert started(node_name, *ros_arguments(node_name, namespace="/left/outboard"))[1]


def test_demo_makes_the_actuator_wear_out():
    files = [parameter_file("demo")]
    values, given = started("actuator", *ros_arguments("actuator", parameter_files=files))
    assert given - values.keys() == set()
    assert values["growth.friction.law"] == "exponential"
    # The demo's own seed overrides that of the shipped file.
    assert (declared("actuator")["seed"], values["seed"]) == (0, 1)


def test_later_parameters_override():
    arguments = ros_arguments(
        "actuator", parameter_files=[parameter_file("demo")], assignments=["seed:=7"]
    )
    assert started("actuator", *arguments)[0]["seed"] == 7


@pytest.mark.parametrize("name", ["worn out", ""])
def test_parameter_file_that_is_not_there_is_refused(name):
    with pytest.raises(ValueError, match="run `make setup`"):
        parameter_file(name)
