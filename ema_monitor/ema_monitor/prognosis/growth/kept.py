"""What is learnt of growth, by name: copied, written, and taken up again."""

from collections.abc import Mapping
from copy import copy
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray


class Kept:
    """Base of classes that learn from tests and keep their state in some of their attributes.

    Attributes
    ----------
    kept
        Names of the attributes that tests change, arrays and numbers.
    parts
        Names of the attributes that are of this class themselves.
    """

    kept: ClassVar[tuple[str, ...]] = ()
    parts: ClassVar[tuple[str, ...]] = ()

    def state(self, at: str = "") -> dict[str, NDArray[Any]]:
        """Return all that is known, for ``restore``; names begin with where it is."""
        known = {f"{at}{name}": np.asarray(getattr(self, name)) for name in self.kept}
        for part in self.parts:
            known |= getattr(self, part).state(f"{at}{part}.")
        return known

    def restore(self, state: Mapping[str, NDArray[Any]], at: str = "") -> None:
        """Restore the ``state`` of an object with the same limits and settings.

        Raises
        ------
        KeyError
            When something is missing.
        """
        for name in self.kept:
            value = state[f"{at}{name}"]
            setattr(self, name, value if value.ndim else value.item())
        for part in self.parts:
            getattr(self, part).restore(state, f"{at}{part}.")

    def frozen(self) -> Self:
        """Return a copy that does not change with this one."""
        twin = copy(self)
        for name in self.kept:
            setattr(twin, name, copy(getattr(self, name)))
        for part in self.parts:
            setattr(twin, part, getattr(self, part).frozen())
        return twin
