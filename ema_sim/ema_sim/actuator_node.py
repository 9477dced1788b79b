# SPDX-License-Identifier: Apache-2.0
"""ROS node of a simulated actuator: runs test cycles and publishes its topics."""

import time
from collections.abc import Iterable
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, Final

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

from ema_core.commands import Command
from ema_core.description import ActuatorDescription
from ema_core.faults import FAULT_NAMES
from ema_core.parameters import ActuatorParameters
from ema_interfaces.msg import FaultGrowth
from ema_interfaces.srv import SetCommand, SetSimulatedFaults
from ema_ros import topics
from ema_ros.actuator_file import load_description
from ema_ros.actuator_messages import messages_of_block, messages_of_cycle
from ema_ros.messages import description_to_message, faults_from_message
from ema_ros.node_parameters import LiveSettings, declare, read
from ema_ros.run import run
from ema_ros.status import hardware_name
from ema_sim.bench import ActuatorBench, BenchSettings, MeasuredBlock, RunningCycle
from ema_sim.growth import Growth
from ema_sim.settings import (
    CauseSettings,
    FaultSettings,
    FileSettings,
    ResolutionSettings,
    RunSettings,
)
from ema_sim.simulation_node import SimulationNode

_PAUSE_S: Final = 0.3
_HOLDS: Final = "takes effect at the next test cycle"
_COMMAND_FIGURES: Final = tuple(
    item.name for item in fields(Command) if item.name not in ("shape", "samples")
)


class ActuatorNode(SimulationNode):
    """ROS node that runs a simulated actuator through test cycles.

    Raises
    ------
    ValueError
        If the description of the actuator cannot be read, or a parameter is out of range.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("actuator", **kwargs)
        # Fixed, because the values in the file are the defaults of the plant parameters.
        declare(self, FileSettings, is_fixed=True)
        file = read(self, FileSettings).actuator_file
        self._described = (
            load_description(Path(file), is_simulated=True) if file else ActuatorDescription()
        )
        declare(self, RunSettings)
        self._description = self._named_description()
        declare(self, BenchSettings(pause_s=_PAUSE_S))
        declare(self, Command, "command.")
        declare(self, ResolutionSettings, "resolution.")
        declare(self, FaultSettings, "faults.")
        for name in FAULT_NAMES:
            declare(self, Growth, f"growth.{name}.")
        declare(self, self._described.parameters, "plant.")
        self._causes = LiveSettings(
            self,
            CauseSettings,
            check=lambda new: self.is_configured and self._bench.check_causes(new.causes),
            on_change=lambda new: self.is_configured and self._bench.set_causes(new.causes),
        )

    @property
    def hardware_id(self) -> str:
        """Namespace, name and serial number of the simulated unit."""
        unit = self._description
        return hardware_name(self.unit_namespace, unit.actuator_id, unit.serial_number)

    def configure(self) -> None:
        """Create the bench, the publishers and the services."""
        self._description = self._named_description()
        self._bench = ActuatorBench(
            self._description,
            read(self, BenchSettings),
            parameters=read(self, ActuatorParameters, "plant."),
            resolutions=read(self, ResolutionSettings, "resolution.").resolutions(),
            causes=self._causes.value.causes,
        )
        for remark in self._description.remarks:
            self.get_logger().warning(f"{self._description.actuator_id}: {remark}")
        command = read(self, Command, "command.")
        if warning := command.travel_warning(self._description.parameters):
            self.get_logger().warning(warning)
        self._bench.set_command(command)
        growths = {name: read(self, Growth, f"growth.{name}.") for name in FAULT_NAMES}
        self._bench.set_faults(asdict(read(self, FaultSettings, "faults.")), growths)
        self.run_bench(self._bench, read(self, RunSettings).rate, topics.ACTUATOR_TOPICS)
        group = MutuallyExclusiveCallbackGroup()
        for kind, name, callback in (
            (SetSimulatedFaults, "set_faults", self._set_faults),
            (SetCommand, "set_command", self._set_command),
        ):
            self.create_service(kind, f"~/{name}", callback, callback_group=group)

    def activate(self) -> None:
        """Publish the description, and start the thread that runs cycles."""
        message = description_to_message(self._description, time.time_ns())
        self.publish(topics.DESCRIPTION, message)
        super().activate()

    def publish_cycle(self, cycle: RunningCycle) -> None:
        """Publish faults and usage at the start of a cycle."""
        for topic, message in messages_of_cycle(
            self._description, cycle.start_ns, cycle.number, cycle.hours, cycle.faults
        ).items():
            self.publish(topic, message)

    def publish_block(self, block: MeasuredBlock) -> None:
        """Publish telemetry and joint state."""
        telemetry, torque = block
        self.publish_clock(telemetry.stamp_at(len(telemetry) - 1))
        for topic, message in messages_of_block(self._description, telemetry, torque).items():
            self.publish(topic, message)
        self.report_pace()

    def _named_description(self) -> ActuatorDescription:
        """Return the description with the name and serial number in the parameters."""
        settings = read(self, RunSettings)
        names = {"actuator_id": settings.actuator_id, "serial_number": settings.serial_number}
        return replace(self._described, **{key: name for key, name in names.items() if name})

    def _set_faults(
        self, request: SetSimulatedFaults.Request, response: SetSimulatedFaults.Response
    ) -> SetSimulatedFaults.Response:
        self._bench.set_faults(
            faults_from_message(request.faults),
            _growths(request.growth),
            request.hours_per_cycle or None,
        )
        response.success, response.message = True, _HOLDS
        return response

    def _set_command(
        self, request: SetCommand.Request, response: SetCommand.Response
    ) -> SetCommand.Response:
        command = _command(request)
        self._bench.set_command(command)
        response.success, response.message = True, _HOLDS
        if warning := command.travel_warning(self._description.parameters):
            response.message += f"; warning: {warning}"
        return response


def _growths(messages: Iterable[FaultGrowth]) -> dict[str, Growth]:
    growths: dict[str, Growth] = {}
    for item in messages:
        if item.fault in growths:
            raise ValueError(f"growth of {item.fault} is specified more than once")
        try:
            growths[item.fault] = Growth(item.law, item.rate, item.shape, item.noise, item.onset)
        except ValueError as error:
            raise ValueError(f"growth of {item.fault}: {error}") from error
    return growths


def _command(request: SetCommand.Request) -> Command:
    if request.shape == "custom":
        return Command("custom", samples=request.custom)
    figures = {name: getattr(request, name) for name in _COMMAND_FIGURES}
    return Command(request.shape, **figures)


def main(args: list[str] | None = None) -> int:
    """Run the actuator node and return the exit status."""
    return run(ActuatorNode, args)
