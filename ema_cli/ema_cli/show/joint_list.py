"""List of joints with their columns and the quantities that can be judged from them."""

from collections.abc import Sequence
from dataclasses import dataclass

from ema_core.description import ActuatorDescription
from ema_core.wording import counted

_HEADINGS = ("joint", "rate", "effort", "speed", "command", "can be judged")


@dataclass(frozen=True)
class JointList:
    """Joints of robots, shown as a table of text."""

    joints: Sequence[ActuatorDescription]
    """Descriptions of the joints."""

    def __str__(self) -> str:
        return "\n".join([counted(len(self.joints), "joint"), *self._table()])

    @property
    def lines(self) -> list[str]:
        """One line for each joint."""
        return [
            f"{name}: {rate}, effort {effort}, speed {speed}, command {command}: {judged}"
            for name, rate, effort, speed, command, judged in map(_row, self.joints)
        ]

    def _table(self) -> list[str]:
        rows = [_HEADINGS, *map(_row, sorted(self.joints, key=lambda unit: unit.actuator_id))]
        widths = [max(len(row[i]) for row in rows) for i in range(len(_HEADINGS))]
        return [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
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
    """Return the quantities that records of a joint with these columns can show."""
    if not has_effort:
        return "nothing: the driver publishes no effort"
    lag = ", tracking lag" if has_command else ""
    return f"friction, torque per effort, inertia, load{lag}"
