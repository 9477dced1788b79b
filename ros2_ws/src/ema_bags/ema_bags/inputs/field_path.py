"""Paths of fields in messages, such as ``position[name=flap_joint]``."""

import re
from collections.abc import Sequence
from typing import Any, Final

_STEP = re.compile(r"([A-Za-z_]\w*)((?:\[[^\[\]]+\])*)(?:\.|$)")
_JOINT_NAMES: Final = ("name", "joint_names")
_SELECTOR = re.compile(r"\[([^\[\]]+)\]")


class FieldPath:
    """Where a number stands in a message.

    Names of fields are separated by dots. An element of an array is chosen by its number,
    ``data[0]``, or by a name, ``position[name=flap_joint]``: its number is that of ``flap_joint``
    in the array ``name``, which stands in the same message or in one that contains it. Names that
    are published on a topic of their own are looked up in their latest message. Where the path
    leads to an array of numbers and a joint is given, its element is that of the joint.

    Parameters
    ----------
    text
        The path.
    joint
        Name of a joint, as in the arrays ``name`` or ``joint_names``; empty: none.

    Raises
    ------
    ValueError
        When it is no path.
    """

    def __init__(self, text: str, joint: str = "") -> None:
        self.text = text
        self._joint = joint
        self._steps: list[tuple[str, list[tuple[str, str]]]] = []
        position = 0
        while position < len(text):
            match = _STEP.match(text, position)
            if match is None:
                break
            selectors = []
            for inner in _SELECTOR.findall(match[2]):
                key, equals, value = inner.partition("=")
                if not equals and not key.strip().isdigit():
                    break
                selectors.append((key.strip() if equals else "", (value or key).strip()))
            else:
                self._steps.append((match[1], selectors))
                position = match.end()
                continue
            break
        if not self._steps or position < len(text) or text.endswith("."):
            raise ValueError(
                f"field path {text!r}: expected names of fields separated by dots, with an element "
                "of an array as data[0] or position[name=flap_joint]"
            )

    @property
    def fields(self) -> list[str]:
        """Names of the fields from the message down."""
        return [name for name, _ in self._steps]

    def value(self, message: Any, names: Any = None) -> float:
        """Return the number at the path.

        Parameters
        ----------
        names
            Message in which the arrays of names stand that the message itself does not have.

        Raises
        ------
        ValueError
            When there is no number at the path; the text says what is there instead.
        """
        found: Any = message
        outer: list[Any] = [] if names is None else [names]
        for name, selectors in self._steps:
            if not hasattr(found, name):
                raise ValueError(
                    f"field path {self.text!r}: {type(found).__name__} has no field {name!r}; it "
                    f"has {', '.join(_fields_of(found)) or 'none'}"
                )
            outer.append(found)
            found = getattr(found, name)
            for key, text in selectors:
                found = self._element(found, outer, name, key, text)
        if self._joint and hasattr(found, "__len__") and not isinstance(found, str):
            index = self._number_of(outer, _JOINT_NAMES, self._joint)
            found = self._at(found, index, self._steps[-1][0])
        try:
            return float(found)
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"field path {self.text!r} gives {type(found).__name__}, expected a number: choose "
                "an element or a field of it"
            ) from error

    def _element(self, array: Any, outer: Sequence[Any], name: str, key: str, text: str) -> Any:
        index = int(text) if not key else self._number_of(outer, (key,), text)
        return self._at(array, index, name)

    def _at(self, array: Any, index: int, name: str) -> Any:
        if index >= len(array):
            raise ValueError(
                f"field path {self.text!r}: {name} has {len(array)} elements, expected more than "
                f"{index}"
            )
        return array[index]

    def _number_of(self, outer: Sequence[Any], keys: Sequence[str], wanted: str) -> int:
        for message in reversed(outer):
            for key in keys:
                names = getattr(message, key, None)
                if names is None:
                    continue
                listed = list(names)
                if wanted in listed:
                    return listed.index(wanted)
                raise ValueError(
                    f"field path {self.text!r}: {wanted!r} is not in {key}, which has "
                    f"{', '.join(map(str, listed)) or 'none'}"
                )
        raise ValueError(
            f"field path {self.text!r}: there is no array {' or '.join(keys)} of names for "
            f"{wanted!r}: choose an element by its number, as data[0]"
        )


def _fields_of(message: Any) -> list[str]:
    fields = getattr(type(message), "get_fields_and_field_types", None)
    if fields is not None:
        return list(fields())
    return list(getattr(message, "__dataclass_fields__", ()))
