"""Rows of numbers in little memory: a history has some for each of thousands of tests."""

from collections.abc import Iterator, Mapping
from struct import Struct
from typing import Any, Final, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

_CODES: Final = {"i8": "q", "f8": "d", "?": "?"}

Row = TypeVar("Row", bound=tuple[Any, ...])


class PackedRows(Generic[Row]):
    """Named tuples of numbers in the memory of their bits, to which more can be added.

    Parameters
    ----------
    kind
        The named tuple.
    types
        The type of each field, in their order: ``i8``, ``f8`` or ``?``.
    """

    def __init__(self, kind: type[Row], types: Mapping[str, str]) -> None:
        self._kind, self._types = kind, types
        self._dtype = np.dtype(list(types.items()))
        self._struct = Struct("=" + "".join(_CODES[one] for one in types.values()))
        self._bits = bytearray()

    def append(self, row: Row) -> None:
        """Add a row."""
        self._bits += self._packed(row)

    def __len__(self) -> int:
        return len(self._bits) // self._struct.size

    def __getitem__(self, place: int) -> Row:
        """Return the row at a place, which counts from the end when it is below 0."""
        return self._kind(*self._struct.unpack_from(self._bits, self._start(place)))

    def __setitem__(self, place: int, row: Row) -> None:
        """Put a row in the place of the one at a place, which counts as when it is read."""
        start = self._start(place)
        self._bits[start : start + self._struct.size] = self._packed(row)

    def __iter__(self) -> Iterator[Row]:
        return map(self.__getitem__, range(len(self)))

    def _start(self, place: int) -> int:
        if not -len(self) <= place < len(self):
            raise IndexError(f"place {place} of {len(self)} rows")
        return place % len(self) * self._struct.size

    def _packed(self, row: Row) -> bytes:
        return np.array([tuple(row)], self._dtype).tobytes()

    def column(self, name: str) -> NDArray[Any]:
        """Return a copy of all values of a field, ``(n,)``."""
        return np.frombuffer(bytes(self._bits), self._dtype)[name].copy()

    def only(self, which: NDArray[np.bool_]) -> Self:
        """Return the rows that are chosen, ``(n,)``."""
        chosen = type(self)(self._kind, self._types)
        chosen._bits += np.frombuffer(bytes(self._bits), self._dtype)[which].tobytes()
        return chosen
