"""Messages that are of none of the actuators that a monitor watches."""


class PassedOver:
    """Counts messages that name no actuator, and those that are wrong and name one not watched."""

    def __init__(self) -> None:
        self._nameless = 0
        self._strange = 0
        self._latest = ""

    def add(self, actuator_id: str, reason: str) -> bool:
        """Take note of one; return whether it is the first of its kind.

        Parameters
        ----------
        actuator_id
            Which actuator it names; empty for none.
        reason
            What is wrong with it.
        """
        if not actuator_id:
            self._nameless += 1
            return self._nameless == 1
        self._strange += 1
        self._latest = f"{actuator_id!r}: {reason}"
        return self._strange == 1

    def remarks(self) -> list[str]:
        """Return in words what was passed over."""
        told = []
        if self._nameless:
            told.append(f"{self._nameless} messages without actuator_id were passed over")
        if self._strange:
            told.append(
                f"{self._strange} wrong messages of actuators that are not watched were passed "
                f"over, the latest of {self._latest}"
            )
        return told
