# SPDX-License-Identifier: Apache-2.0
"""List of joints, with their columns and the quantities that can be determined from these."""

from collections.abc import Sequence
from dataclasses import dataclass

from ema_bags.inputs.abilities import abilities_by_columns
from ema_bags.inputs.examination_wording import ABILITY_NAMES
from ema_core.description import ActuatorDescription
from ema_core.wording import counted, text_table

_HEADINGS = ("joint", "rate", "effort", "speed", "command", "can be judged")


@dataclass(frozen=True)
class JointList:
    """List of joints that is shown as a table (``str``) or as lines."""

    joints: Sequence[ActuatorDescription]
    """Descriptions of the joints."""

    def __str__(self) -> str:
        rows = map(_row, sorted(self.joints, key=lambda unit: unit.actuator_id))
        return f"{counted(len(self.joints), 'joint')}\n{text_table(_HEADINGS, list(rows))}"

    @property
    def lines(self) -> list[str]:
        """One line for each joint."""
        return [
            f"{name}: {rate}, effort {effort}, speed {speed}, command {command}: {judged}"
            for name, rate, effort, speed, command, judged in map(_row, self.joints)
        ]


def _row(unit: ActuatorDescription) -> tuple[str, ...]:
    acquisition = unit.acquisition
    has_effort = acquisition.current != "none"
    return (
        unit.actuator_id,
        f"{1.0 / unit.sample_period:g} Hz",
        acquisition.effort_unit if has_effort else "no",
        "measured" if acquisition.speed else "derived",
        "yes" if acquisition.command else "no",
        _judged(has_effort=has_effort, has_command=acquisition.command),
    )


def _judged(*, has_effort: bool, has_command: bool) -> str:
    """Return the quantities that can be determined from records with these columns, as text."""
    abilities = abilities_by_columns(has_effort=has_effort, has_command=has_command)
    listed = ", ".join(ABILITY_NAMES[ability] for ability in abilities)
    return listed or "nothing: the driver publishes no effort"
