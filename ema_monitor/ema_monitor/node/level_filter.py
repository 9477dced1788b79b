"""Levels that do not flicker: a change counts when it is confirmed."""


class LevelFilter:
    """A level of health that changes once several estimates in a row say so.

    The first level is taken at once and is a change. What lies between two levels is no detour:
    estimates that differ from the level to the same side confirm each other, and the last of them
    is taken.

    Attributes
    ----------
    level
        The level; None as long as there was none.
    """

    def __init__(self) -> None:
        self.level: int | None = None
        self._differing = 0

    def add(self, level: int, confirmations: int) -> bool:
        """Add the level after an estimate; return whether the filtered one has changed.

        Parameters
        ----------
        level
            What the estimate says.
        confirmations
            How many estimates in a row make a change.
        """
        if self.level is None:
            self.level = level
            return True
        side = (level > self.level) - (level < self.level)
        if side * self._differing < 0:
            self._differing = 0
        self._differing = self._differing + side if side else 0
        if abs(self._differing) < confirmations:
            return False
        self.level, self._differing = level, 0
        return True
