# SPDX-License-Identifier: Apache-2.0
"""Interface of the simulated actuator's node to other nodes."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from ema_core.commands import Command, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import COLUMNS, join
from ema_interfaces.msg import FaultGrowth
from ema_interfaces.srv import SetCommand, SetSimulatedFaults
from ema_ros.messages import (
    description_from_message,
    faults_to_message,
    stamped_faults_from_message,
    telemetry_from_message,
)
from ema_ros.stamps import stamp_from_message
from ema_ros.topics import ACTUATOR_TOPICS, LATCHED
from ema_sim import runner
from ema_sim.actuator_node import ActuatorNode
from ema_sim.bench import ActuatorBench, BenchSettings
from ema_sim.growth import Growth, grow

from .spinning import Probe, figures, probed

# A step of 20 ms, and 1.1 s of approach and return; 1.17 s in total with the pause.
SHORT = {"command.shape": "step", "command.amplitude": 1e-3, "command.duration": 0.02}
PAUSE = {"pause_s": 0.05}
CYCLE_SAMPLES = len(build_cycle(Command("step", 1e-3, 0.02), 1e-4).samples) + 500
EVERY_MESSAGE = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
RNG = np.random.default_rng(0)  # for laws without noise


@pytest.fixture(scope="module", autouse=True)
def _kernels():
    ActuatorBench(ActuatorDescription()).compile_kernels()


class Listener(Probe):
    """A probe that receives the messages of an actuator node."""

    def __init__(self, context: Context, node: ActuatorNode) -> None:
        super().__init__(context, node)
        for name, (message_class, qos) in ACTUATOR_TOPICS.items():
            self.subscribe(message_class, name, EVERY_MESSAGE if qos is LATCHED else qos)
        self.subscribe(Clock, "/clock", BEST_EFFORT)

    def blocks(self) -> list[Any]:
        return [telemetry_from_message(message) for message in self.received("telemetry")]

    def truths(self) -> list[Any]:
        return [stamped_faults_from_message(m) for m in self.received("simulated_faults")]

    def close(self) -> None:
        assert not self.failures, self.failures


def listening(**parameters: Any) -> AbstractContextManager[Listener]:
    """Return a context with the listener of a new node that is not yet configured."""
    return probed(ActuatorNode, Listener, {**SHORT, **PAUSE, **parameters})


@contextmanager
def running(**parameters: Any) -> Iterator[Listener]:
    """Yield the listener of a new, active node."""
    with listening(**parameters) as listener:
        assert listener.node.bring_up()
        yield listener


def two_cycles_in_real_time() -> Listener:
    faults = {"faults.friction": 0.25, "faults.gain": 0.6}
    noise = {"current_noise": 0.05, "noise_gain": 1.0, "seed": 7, "resolution.position": 1e-6}
    with running(**faults, **noise, **{"plant.resistance": 2.2, "load": 0.01}) as listener:
        for name in ("simulated_faults", "usage"):
            listener.until(lambda name=name: len(listener.received(name)) > 2)
        for name in ("actuator_description", "simulated_faults", "usage"):
            listener.subscribe(ACTUATOR_TOPICS[name][0], name, LATCHED, key=f"late {name}")
            listener.until(lambda name=name: listener.received(f"late {name}"))
        count = len(listener.received("/diagnostics"))
        listener.until(lambda: len(listener.received("/diagnostics")) > count)
    return listener


@pytest.fixture(scope="module")
def real_time() -> Listener:
    """Messages of two cycles with noise and faults; the node has ended.

    Its schedule is never shifted here, even if it is late on a busy machine.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "TOLERANCE_S", 1e6)
        return two_cycles_in_real_time()


def test_cycles_are_contiguous_and_stamped_with_their_start(real_time):
    truths = real_time.truths()
    assert [truth.cycle for truth in truths[:3]] == [0, 1, 2]
    np.testing.assert_array_equal(
        np.diff([truth.stamp_ns for truth in truths[:3]]), CYCLE_SAMPLES * 100_000
    )
    counts = real_time.received("usage")[:3]
    assert [stamp_from_message(count.header.stamp) for count in counts] == [
        truth.stamp_ns for truth in truths[:3]
    ]
    assert [(count.flight_hours, count.cycles) for count in counts] == [
        (0.0, 1),
        (10.0, 2),
        (20.0, 3),
    ]


def test_samples_equal_the_samples_of_the_bench(real_time):
    description = ActuatorDescription()
    twin = ActuatorBench(
        description,
        BenchSettings(pause_s=0.05, load=0.01, noise_gain=1.0, current_noise=0.05, seed=7),
        parameters=description.parameters.replace({"R_s": 2.2}),
        resolutions={"position": 1e-6},
    )
    twin.set_command(Command("step", 1e-3, 0.02))
    twin.set_faults({"friction": 0.25, "gain": 0.6})
    expected = [(b, t) for _ in range(2) for b, t in twin.begin_cycle().blocks]
    whole = join([block for block, _ in expected])
    numbers = np.array([(block.first_index, len(block)) for block in real_time.blocks()])
    np.testing.assert_array_equal(numbers[1:, 0], numbers[:-1].sum(axis=1))
    assert {m.actuator_id for m in real_time.received("telemetry")} == {"flap"}
    for block in real_time.blocks()[:200]:
        assert block.sample_period == 1e-4
        start = block.first_index - 1
        for column in COLUMNS:
            part = getattr(whole, column)[start : start + len(block)]
            np.testing.assert_array_equal(getattr(block, column), part)

    torques = {block.first_index: torque for block, torque in expected}
    tau = description.parameters.tau
    joints = {stamp_from_message(j.header.stamp): j for j in real_time.received("joint_states")}
    compared = [b for b in real_time.blocks()[:200] if int(b.stamps_ns[-1]) in joints]
    # A slow receiver loses joint states, because the queue has a depth of ten.
    assert len(compared) >= 0.5 * 200
    for block in compared:
        joint = joints[int(block.stamps_ns[-1])]
        assert list(joint.name) == ["flap"]
        assert joint.position[0] == block.position[-1]
        assert joint.velocity[0] == pytest.approx(tau * block.speed[-1], rel=1e-12)
        assert joint.effort[0] == pytest.approx(torques[block.first_index] / tau, rel=1e-12)
    assert max(abs(joint.effort[0]) for joint in joints.values()) > 1.0


def test_late_subscriber_receives_description_usage_and_faults(real_time):
    [description] = real_time.received("late actuator_description")
    # The description has the nominal parameters: the monitor has to find the resistance.
    assert description_from_message(description) == ActuatorDescription()
    usage = real_time.received("late usage")[0]
    assert (usage.actuator_id, usage.serial_number) == ("flap", "SIM-0001")
    assert usage.flight_hours == 10.0 * (usage.cycles - 1)
    truth = stamped_faults_from_message(real_time.received("late simulated_faults")[0])
    assert truth.actuator_id == "flap"
    np.testing.assert_array_equal(truth.faults, fault_vector({"friction": 0.25, "gain": 0.6}))


def growth(fault: str, law: str, rate: float, **figures: float) -> FaultGrowth:
    return FaultGrowth(fault=fault, law=law, rate=rate, **figures)


def test_faults_are_set_and_grow_from_the_next_cycle_on():
    start = fault_vector({"friction": 0.1, "gain": 0.4})
    with running(rate=8.0, block_s=0.08, hours_per_cycle=50.0) as listener:
        listener.until(lambda: len(listener.received("simulated_faults")) > 1)
        request = SetSimulatedFaults.Request(
            faults=faults_to_message(start),
            growth=[growth("friction", "linear", 1e-3)],
            hours_per_cycle=20.0,
        )
        before = len(listener.truths())
        response = listener.call(SetSimulatedFaults, "actuator/set_faults", request)
        assert response.success
        assert "next test cycle" in response.message
        called = len(listener.truths())
        listener.until(lambda: len(listener.received("simulated_faults")) >= called + 4)
        truths = listener.truths()
        listener.until(lambda: len(listener.received("usage")) >= len(truths))
    # New faults are not a new unit: its service life continues.
    hours = [count.flight_hours for count in listener.received("usage")[: called + 4]]
    assert hours[0] == 0.0
    assert set(np.diff(hours)) == {50.0, 20.0}
    changed = next(i for i, truth in enumerate(truths) if truth.faults[0] > 0.0)
    assert before <= changed <= called + 1
    np.testing.assert_array_equal(truths[changed - 1].faults, healthy_faults())
    after = start
    for i, truth in enumerate(truths[changed:]):
        np.testing.assert_array_equal(truth.faults, after)
        after = grow(after, {"friction": Growth("linear", 1e-3)}, 20.0 * i, 20.0, RNG)


def test_command_is_set_from_the_next_cycle_on():
    samples = 1e-3 * np.sin(np.linspace(0.0, 3.0, 300))
    with running(rate=8.0, block_s=0.08) as listener:
        listener.until(lambda: listener.received("telemetry"))
        request = SetCommand.Request(shape="custom", custom=samples.tolist())
        response = listener.call(SetCommand, "actuator/set_command", request)
        assert response.success
        called = len(listener.truths())
        listener.until(lambda: len(listener.received("simulated_faults")) >= called + 2)
        listener.until(lambda: listener.blocks()[-1].stamp_ns > listener.truths()[-1].stamp_ns)
        blocks, starts = listener.blocks(), [truth.stamp_ns for truth in listener.truths()]
    cycle = [block for block in blocks if starts[-2] < block.stamp_ns < starts[-1]]
    expected = build_cycle(Command("custom", samples=samples), 1e-4).samples
    np.testing.assert_array_equal(join(cycle).command[: len(expected)], expected)
    np.testing.assert_array_equal(join(cycle).command[len(expected) :], np.zeros(500))


def test_impossible_faults_are_refused_and_simulated_time_is_published():
    """The simulation runs at four times real time."""
    healthy, wrong = (faults_to_message(healthy_faults()) for _ in range(2))
    wrong.friction = 1.5
    twice = [growth("gain", "linear", 0.1)] * 2
    with running(rate=4.0, block_s=0.04) as listener:
        for faults, laws, message in (
            (wrong, [], "fault friction = 1.5 is outside [0, 1]"),
            (healthy, twice, "gain is specified more than once"),
        ):
            request = SetSimulatedFaults.Request(faults=faults, growth=laws, hours_per_cycle=1.0)
            response = listener.call(SetSimulatedFaults, "actuator/set_faults", request)
            assert not response.success
            assert message in response.message
        status = listener.until(lambda: listener.statuses("simulation"))[-1]
        assert {item.key: item.value for item in status.values}["rate"] == "4"

        def clocks() -> list[int]:
            return [stamp_from_message(message.clock) for message in listener.received("/clock")]

        def ends() -> set[int]:
            return {int(block.stamps_ns[-1]) for block in listener.blocks()}

        listener.until(lambda: len(clocks()) >= 100)
        # There is no order between topics: blocks of the first clocks may still be on their way.
        listener.until(lambda: len(ends().intersection(clocks()[:100])) > 90)
        assert clocks() == sorted(clocks())


def test_lag_is_logged_once_and_quantified_in_the_status(capfd):
    with running(rate=100.0, block_s=2e-3) as listener:
        listener.until(lambda: len(listener.received("simulated_faults")) >= 3)
        worst = listener.until(
            lambda: [s for s in listener.statuses("simulation") if s.level != DiagnosticStatus.OK]
        )[-1]
    assert worst.level == DiagnosticStatus.WARN
    assert worst.message.startswith("cannot keep up: lag ")
    values = figures(worst)
    assert values["lag [s]"] > 0.1
    assert 0.0 < values["achieved rate"] < 50.0
    assert values["busy share"] > 0.7
    assert capfd.readouterr().err.count("cannot keep up") == 1


def test_reactivated_node_begins_a_new_cycle():
    # The pause is so long that no other cycle starts by itself.
    with running(pause_s=20.0) as listener:
        listener.until(lambda: len(listener.received("telemetry")) > 5)
        listener.node.trigger_deactivate()
        listener.node.trigger_activate()
        listener.until(lambda: [truth.cycle for truth in listener.truths()] == [0, 1])
        # After cleanup and configuration it is a new actuator.
        listener.node.trigger_deactivate()
        listener.node.trigger_cleanup()
        assert listener.node.bring_up()
        listener.until(lambda: [truth.cycle for truth in listener.truths()] == [0, 1, 0])


def test_causes_are_set_like_faults_and_refused_by_name():
    with running(causes=["position_offset=0.01"]) as listener:
        listener.until(lambda: len(listener.received("telemetry")) > 2)
        node = listener.node

        def change(texts: list[str]) -> Any:
            return node.set_parameters([Parameter("causes", Parameter.Type.STRING_ARRAY, texts)])[0]

        refused = change(["position_ofset=0.01"])
        assert not refused.successful
        assert "did you mean 'position_offset'" in refused.reason
        assert change(["position_offset=-0.02", "current_offset=1@0.01"]).successful
        listener.until(lambda: any(block.position[0] < -0.01 for block in listener.blocks()))
        assert change([""]).successful
    positions = [block.position[0] for block in listener.blocks()]
    assert positions[0] == pytest.approx(0.01, abs=1e-3)


def impossible(**parameters: Any) -> str:
    """Return the message with which a node refuses parameters, at construction or configuration."""
    try:
        with listening(**parameters) as listener:
            assert not listener.node.bring_up()
            assert listener.node.state == "unconfigured"
            return listener.until(
                lambda: [s.message for s in listener.statuses("lifecycle") if "cannot" in s.message]
            )[0]
    except ValueError as error:
        return str(error)


@pytest.mark.parametrize(
    ("name", "value", "parts"),
    [
        ("growth.friction.law", "rust", ("growth.friction.law", "'rust'", "archard")),
        ("growth.gain.law", "power", ("growth.gain.rate", "time scale")),
        ("plant.resistance", -2.0, ("plant.resistance", "-2", "ohm", "R_s")),
        ("plant.resistance", "thick", ("plant.resistance", "'thick'", "ohm")),
        ("plant.R_s", 2.2, ("plant.R_s is named plant.resistance",)),
        ("causes", ["load_torque=99"], ("load_torque", "99", "[-10, 10] N.m")),
        ("causes", "load_torque=1", ("causes", "'load_torque=1'", "list of strings")),
        ("actuator_file", "/missing.yaml", ("actuator file", "/missing.yaml", "No such file")),
    ],
)
def test_impossible_parameter_is_refused_by_name(name, value, parts):
    message = impossible(**{name: value})
    for part in parts:
        assert part in message


def test_description_file_defines_the_nominal_plant(tmp_path):
    file = tmp_path / "slat.yaml"
    file.write_text("actuator_id: slat\nserial_number: S-7\nparameters: {R_s: 1.9, P: 4}\n")
    with running(actuator_file=str(file)) as listener:
        listener.until(lambda: listener.received("telemetry"))
        [message] = listener.received("actuator_description")
        node = listener.node
        names = "resistance", "pole_pairs", "inductance"
        plant = [node.get_parameter(f"plant.{name}").value for name in names]
    description = description_from_message(message)
    assert (description.actuator_id, description.serial_number) == ("slat", "S-7")
    assert description.parameters == ActuatorParameters(R_s=1.9, P=4)
    assert plant == [1.9, 4, ActuatorParameters().L_s]
    assert listener.received("telemetry")[0].actuator_id == "slat"
