"""Learnt state of the growth models: copied, stored and restored by name."""

from collections.abc import Mapping
from copy import copy
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray


class Kept:
    """Base of classes that learn from tests, with their state in some of their attributes."""

    kept: ClassVar[tuple[str, ...]] = ()
    """Names of the attributes that tests change: arrays and numbers."""
    parts: ClassVar[tuple[str, ...]] = ()
    """Names of the attributes that are ``Kept`` objects."""

    def state(self, at: str = "") -> dict[str, NDArray[Any]]:
        """Return the learnt state for ``restore``, by names with the prefix ``at``."""
        state = {f"{at}{name}": np.asarray(getattr(self, name)) for name in self.kept}
        for part in self.parts:
            state |= getattr(self, part).state(f"{at}{part}.")
        return state

    def restore(self, state: Mapping[str, NDArray[Any]], at: str = "") -> None:
        """Restore the ``state`` of an object with the same limits and settings.

        Raises
        ------
        KeyError
            If something is missing.
        """
        for name in self.kept:
            value = state[f"{at}{name}"]
            setattr(self, name, value if value.ndim else value.item())
        for part in self.parts:
            getattr(self, part).restore(state, f"{at}{part}.")

    def frozen(self) -> Self:
        """Return a copy that is independent of further tests."""
        twin = copy(self)
        for name in self.kept:
            setattr(twin, name, copy(getattr(self, name)))
        for part in self.parts:
            setattr(twin, part, getattr(self, part).frozen())
        return twin
