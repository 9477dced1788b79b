from dataclasses import replace

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.reader import Bag
from ema_bags.writer import BagWriter
from ema_core.cause_profiles import cause_profiles
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_ros import topics
from ema_ros.messages import description_from_message, stamped_faults_from_message
from ema_sim.actuator import SimulatedActuator

from .recorded_messages import ros_messages


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Two cycles of 30 ms with other faults, and what was written."""
    description = replace(ActuatorDescription(), serial_number="SN-3")
    actuator = SimulatedActuator(description.parameters)
    path = tmp_path_factory.mktemp("bag") / "two.mcap"
    written = []
    with SimulatedActuatorBag(BagWriter(path), description) as bag:
        for cycle, friction in enumerate((0.1, 0.2)):
            bag.begin_cycle(cycle, fault_vector({"friction": friction}), 10.0 * cycle)
            for _ in range(3):
                block = actuator.advance(np.full(100, 1e-3))
                bag.write_block(block, actuator.state.torque)
                written.append((block, actuator.state.torque))
    return description, written, ros_messages(Bag(path))


def on(recorded, name):
    return [item for item in recorded[2] if item.topic == f"{topics.NAMESPACE}/{name}"]


def test_description_comes_first(recorded):
    assert recorded[2][0].topic.endswith(topics.DESCRIPTION)
    [item] = on(recorded, topics.DESCRIPTION)
    assert description_from_message(item.message) == recorded[0]


def test_truth_is_stamped_with_the_start_of_its_cycle(recorded):
    truths = [stamped_faults_from_message(i.message) for i in on(recorded, topics.SIMULATED_FAULTS)]
    assert [(t.cycle, t.faults[0], t.stamp_ns) for t in truths] == [
        (0, 0.1, 0),
        (1, 0.2, 30_000_000),
    ]


def test_service_life_is_counted_at_the_start_of_each_cycle(recorded):
    counts = [item.message for item in on(recorded, topics.USAGE)]
    assert {(m.actuator_id, m.serial_number) for m in counts} == {("flap", "SN-3")}
    assert [(m.flight_hours, m.cycles) for m in counts] == [(0.0, 1), (10.0, 2)]
    truths = [item.message for item in on(recorded, topics.SIMULATED_FAULTS)]
    assert [m.header.stamp for m in counts] == [m.header.stamp for m in truths]


def test_joint_state_is_that_of_the_user_shaft(recorded):
    tau = recorded[0].parameters.tau
    joints = [item.message for item in on(recorded, topics.JOINT_STATES)]
    assert len(joints) == len(recorded[1])
    for joint, (block, torque) in zip(joints, recorded[1], strict=True):
        assert list(joint.name) == ["flap"]
        assert list(joint.position) == [block.position[-1]]
        assert list(joint.velocity) == [tau * block.speed[-1]]
        assert list(joint.effort) == [torque / tau]


def test_telemetry_is_received_at_its_last_sample(recorded):
    for item, (block, _) in zip(on(recorded, topics.TELEMETRY), recorded[1], strict=True):
        assert item.publish_time_ns == block.stamp_ns
        assert item.log_time_ns == block.stamps_ns[-1]
        assert item.message.first_index == block.first_index
        np.testing.assert_array_equal(item.message.current, block.current)


@pytest.mark.parametrize("name", ["case.mcap", "case"])
def test_hidden_causes_are_in_the_metadata(tmp_path, name):
    with SimulatedActuatorBag(BagWriter(tmp_path / name), ActuatorDescription()) as bag:
        bag.note_causes(cause_profiles(["load_torque=0.01", "winding_temperature=80@0..10"]))
        bag.write_block(SimulatedActuator().advance(np.zeros(2)))
    noted = {"hidden_causes": "load_torque=0.01 winding_temperature=80@0..10"}
    file = tmp_path / name if name.endswith("mcap") else tmp_path / name / f"{name}_0.mcap"
    with file.open("rb") as stream:
        [record] = [item for item in make_reader(stream).iter_metadata() if item.name == "rosbag2"]
    assert yaml.safe_load(record.metadata["serialized_metadata"])["custom_data"] == noted
    assert cause_profiles(noted["hidden_causes"].split())["load_torque"].value == 0.01
