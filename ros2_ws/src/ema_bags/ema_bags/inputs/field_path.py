# SPDX-License-Identifier: Apache-2.0
"""Paths to numbers in messages, such as ``position[name=flap_joint]``."""

import re
from collections.abc import Sequence
from typing import Any, Final

_STEP: Final = re.compile(r"([A-Za-z_]\w*)((?:\[(?:\s*\d+\s*|[^\[\]=]*=[^\[\]]*)\])*)")
_SELECTOR: Final = re.compile(r"\[(?:([^\[\]=]*)=)?([^\[\]]*)\]")
_JOINT_NAMES: Final = ("name", "joint_names")


class FieldPath:
    """Path to a number in a message.

    Field names are separated by dots. An array element is selected by index, ``data[0]``, or by
    name, ``position[name=flap_joint]``. In the latter case, the index is the position of
    ``flap_joint`` in the array ``name`` of the same or an enclosing message. Names published on a
    separate topic are taken from its latest message. If the path leads to an array of numbers and a
    joint is given, the element of that joint is used.

    Parameters
    ----------
    text
        The path.
    joint
        Name of a joint in the array ``name`` or ``joint_names``; empty for none.

    Raises
    ------
    ValueError
        If the text is not a valid path.
    """

    def __init__(self, text: str, joint: str = "") -> None:
        self._text, self._joint = text, joint
        # Dots within brackets belong to a name.
        steps = [_STEP.fullmatch(part) for part in re.split(r"\.(?![^\[\]]*\])", text)]
        if not all(steps):
            raise ValueError(
                f"field path {text!r}: expected field names separated by dots, and array "
                "elements such as data[0] or position[name=flap_joint]"
            )
        self._steps = [(step[1], _SELECTOR.findall(step[2])) for step in steps if step]

    def value(self, message: Any, names: Any = None) -> float:
        """Return the number at the path.

        Parameters
        ----------
        message
            The message.
        names
            Message with the arrays of names, if published on a separate topic.

        Raises
        ------
        ValueError
            If there is no number at the path; the error describes the value found there.
        """
        value: Any = message
        outer: list[Any] = [] if names is None else [names]
        for name, selectors in self._steps:
            if not hasattr(value, name):
                raise self._error(
                    f": {type(value).__name__} has no field {name!r}; its fields are "
                    f"{', '.join(_fields_of(value)) or 'none'}"
                )
            outer.append(value)
            value = getattr(value, name)
            for key, selector in selectors:
                keys = (key.strip(),) if key else ()
                value = self._element(value, name, outer, keys, selector.strip())
        if self._joint and hasattr(value, "__len__") and not isinstance(value, str):
            value = self._element(value, self._steps[-1][0], outer, _JOINT_NAMES, self._joint)
        try:
            return float(value)
        except (TypeError, ValueError) as error:
            raise self._error(
                f" gives {type(value).__name__}, expected a number: select an element or field"
            ) from error

    def _element(
        self, array: Any, name: str, outer: Sequence[Any], keys: Sequence[str], selector: str
    ) -> Any:
        index = self._number_of(outer, keys, selector) if keys else int(selector)
        if index >= len(array):
            raise self._error(f": {name} has {len(array)} elements, expected more than {index}")
        return array[index]

    def _number_of(self, outer: Sequence[Any], keys: Sequence[str], element: str) -> int:
        for message in reversed(outer):
            for key in keys:
                names = getattr(message, key, None)
                if names is None:
                    continue
                listed = list(names)
                if element in listed:
                    return listed.index(element)
                listing = ", ".join(map(str, listed)) or "none"
                raise self._error(f": {element!r} is not in {key}, which has {listing}")
        raise self._error(
            f": there is no name array {' or '.join(keys)} to find {element!r} in: select the "
            "element by index, such as data[0]"
        )

    def _error(self, detail: str) -> ValueError:
        return ValueError(f"field path {self._text!r}{detail}")


def _fields_of(message: Any) -> list[str]:
    fields = getattr(type(message), "get_fields_and_field_types", None)
    if fields is not None:
        return list(fields())
    return list(getattr(message, "__dataclass_fields__", ()))
