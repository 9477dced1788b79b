"""The actuators that a monitor watches, by name."""

from ema_monitor.monitor_unit import Unit


class Units(dict[str, Unit]):
    """Units by ``actuator_id``, in the order in which they were heard of."""

    def find(self, actuator_id: str) -> Unit:
        """Return one that is described.

        Parameters
        ----------
        actuator_id
            Which; empty for the only one.

        Raises
        ------
        ValueError
            When it is not watched, not described, or there is a choice.
        """
        watched = ", ".join(self) or "none"
        if not actuator_id and len(self) != 1:
            raise ValueError(f"actuator_id is empty: expected one of those watched: {watched}")
        unit = self.get(actuator_id) if actuator_id else next(iter(self.values()))
        if unit is None:
            raise ValueError(f"actuator_id = {actuator_id!r} is not watched; watched: {watched}")
        if unit.watch.description is None:
            raise ValueError(f"actuator {unit.actuator_id!r} has not been described")
        return unit
