"""Levels that do not flicker: a level that falls is confirmed first."""


class LevelFilter:
    """A level of health that rises at once, and falls once several estimates in a row say so.

    Attributes
    ----------
    level
        The level; None as long as there was none.
    """

    def __init__(self) -> None:
        self.level: int | None = None
        self._lower = 0

    def add(self, level: int, confirmations: int) -> bool:
        """Add the level after an estimate; return whether the filtered one has changed.

        Parameters
        ----------
        level
            What the estimate says.
        confirmations
            How many estimates in a row make a lower level.
        """
        if self.level is None or level > self.level:
            self.level, self._lower = level, 0
            return True
        self._lower = self._lower + 1 if level < self.level else 0
        if self._lower < confirmations:
            return False
        self.level, self._lower = level, 0
        return True
