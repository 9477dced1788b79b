# SPDX-License-Identifier: Apache-2.0
"""Base class for copying, storing and restoring the learnt state of growth models."""

from collections.abc import Mapping
from copy import copy
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray


class Kept:
    """Base class of objects that learn from tests and keep their state in named attributes."""

    kept: ClassVar[tuple[str, ...]] = ()
    """Names of state attributes: arrays and numbers."""
    parts: ClassVar[tuple[str, ...]] = ()
    """Names of attributes that are ``Kept`` objects themselves."""

    def state(self, at: str = "") -> dict[str, NDArray[Any]]:
        """Return the learnt state as a dict for ``restore``; keys start with the prefix ``at``."""
        state = {f"{at}{name}": np.asarray(getattr(self, name)) for name in self.kept}
        for part in self.parts:
            state |= getattr(self, part).state(f"{at}{part}.")
        return state

    def restore(self, state: Mapping[str, NDArray[Any]], at: str = "") -> None:
        """Restore a state that ``state`` returned for an object with the same limits and settings.

        Raises
        ------
        KeyError
            If an entry is missing.
        """
        for name in self.kept:
            value = state[f"{at}{name}"]
            setattr(self, name, value if value.ndim else value.item())
        for part in self.parts:
            getattr(self, part).restore(state, f"{at}{part}.")

    def frozen(self) -> Self:
        """Return an independent copy."""
        twin = copy(self)
        for name in self.kept:
            setattr(twin, name, copy(getattr(self, name)))
        for part in self.parts:
            setattr(twin, part, getattr(self, part).frozen())
        return twin
