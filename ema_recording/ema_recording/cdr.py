"""The end of serialised messages."""

from collections.abc import Callable
from functools import cache

from ema_recording.schema import schema_text, typestore


@cache
def trimmer(name: str) -> Callable[[bytes], bytes] | None:
    """Return what cuts off what is behind the content of a message; None where nothing is.

    ROS reserves the padding of empty sequences, does not use it, and leaves it behind the message,
    ``serialize_message`` and raw subscriptions alike. Readers that check where a message ends
    refuse more than 3 bytes there.

    Parameters
    ----------
    name
        An installed message type.

    Raises
    ------
    ValueError
        When it is not installed.
    """
    schema = schema_text(name)
    if "[" not in schema:
        return None
    store = typestore(name, schema)
    definition = store.get_msgdef(name)
    ends = {
        b"\x00\x00": definition.deserialize_cdr_be,
        b"\x00\x01": definition.deserialize_cdr_le,
    }

    def trim(data: bytes) -> bytes:
        end_of = ends.get(data[:2])
        if end_of is None:
            return data
        try:
            _, end = end_of(data[4:], 0, definition.cls, store)
        except Exception:
            return data
        return data[: 4 + end]

    return trim
