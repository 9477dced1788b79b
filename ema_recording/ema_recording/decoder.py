"""Messages from CDR by the definition that is recorded with them: reading needs no ROS."""

from collections.abc import Callable
from functools import cache
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys.base import TypesysError
from rosbags.typesys.msg import get_types_from_msg
from rosbags.typesys.store import Typestore


@cache
def decoder(type_name: str, schema: str) -> Callable[[bytes], Any]:
    """Return the function that decodes messages of a type.

    The messages have the attributes that the definition names; sequences of numbers are arrays.

    Parameters
    ----------
    type_name
        Name of the type, such as ``std_msgs/msg/Header``.
    schema
        Its definition and those of all that it contains (``ros2msg``).

    Raises
    ------
    ValueError
        When the definition cannot be read; the function, when a message is none of the type.
    """
    # A store for each: two recordings may have different versions of a type.
    store = Typestore()
    try:
        store.register(get_types_from_msg(schema, type_name))
        store.get_msgdef(type_name)
    except (TypesysError, SerdeError, LookupError) as error:
        raise ValueError(f"the definition of {type_name} cannot be read: {error}") from error

    def decode(data: bytes) -> Any:
        try:
            return store.deserialize_cdr(data, type_name)
        except (SerdeError, IndexError) as error:
            raise ValueError(f"no {type_name}: {error}") from error

    return decode
