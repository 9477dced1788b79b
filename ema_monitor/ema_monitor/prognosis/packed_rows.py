"""Rows of numbers in little memory: a history has some for each of thousands of tests."""

from collections.abc import Iterator
from functools import cache
from struct import Struct
from typing import Any, Final, Generic, Self, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

# The same in the formats of struct and numpy.
_CODES: Final = {int: "q", float: "d", bool: "?"}

Row = TypeVar("Row", bound=tuple[Any, ...])


class PackedRows(Generic[Row]):
    """Named tuples of numbers in the memory of their bits, to which more can be added.

    Parameters
    ----------
    kind
        The named tuple; each field is an ``int`` of 64 bits, a ``float`` or a ``bool``.
    """

    def __init__(self, kind: type[Row]) -> None:
        self._kind = kind
        self._struct, self._dtype = _layout(kind)
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
        chosen = type(self)(self._kind)
        chosen._bits += np.frombuffer(bytes(self._bits), self._dtype)[which].tobytes()
        return chosen


@cache
def _layout(kind: type[tuple[Any, ...]]) -> tuple[Struct, np.dtype[Any]]:
    """Return how a row of a named tuple lies in memory, for one row and for columns."""
    codes = {name: _CODES[one] for name, one in get_type_hints(kind).items()}
    return Struct("=" + "".join(codes.values())), np.dtype(list(codes.items()))
