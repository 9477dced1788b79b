"""Sources of several topics, joined at the samples of the position."""

from collections.abc import Mapping as ByTopic
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.mapping import Mapping
from ema_bags.inputs.series import NO_STAMP, Series

_WIDEST: Final = 10.0


def uses_arrival(series: Series, mapping: Mapping) -> bool:
    """Return whether the samples of a topic have no stamps other than those of their arrival."""
    by_arrival = mapping.clock.source in ("sent", "arrival")
    return by_arrival or not np.any(series.stamps_ns != NO_STAMP)


def stamped(series: Series) -> tuple[NDArray[np.int64], int]:
    """Return the stamps of samples, ``(n,)`` [ns], and how many of them were rebuilt.

    Where only some samples carry a stamp, the others have their arrival, less the usual delay.

    Parameters
    ----------
    series
        Samples of which some carry a stamp.
    """
    missing = series.stamps_ns == NO_STAMP
    if not np.any(missing):
        return series.stamps_ns, 0
    there = ~missing
    delay = np.median(series.arrivals_ns[there] - series.stamps_ns[there])
    stamps = np.where(missing, series.arrivals_ns - np.int64(delay), series.stamps_ns)
    return stamps, int(np.count_nonzero(missing))


def join_topics(
    by_topic: ByTopic[str, Series], mapping: Mapping, stamps_ns: NDArray[np.int64]
) -> dict[str, NDArray[np.float64]]:
    """Return what the sources hold at the samples of the position, by the keys of ``wanted``.

    Each is ``(n,)``; not a number where a source has nothing.

    Parameters
    ----------
    by_topic
        Series by topic. That of the position may have more samples than there are stamps: the
        later ones are left out.
    stamps_ns
        Stamps of the samples of the position, ``(n,)`` [ns].
    """
    own = by_topic[mapping.position.topic]
    count = len(stamps_ns)
    raw = {key: values[:count] for key, values in own.values.items()}
    arrivals = own.arrivals_ns[:count]
    for key, _, item in mapping.wanted():
        if item.topic == mapping.position.topic:
            continue
        other = by_topic[item.topic]
        # What has no stamp is compared by when it was sent: the clocks of stamps and of the
        # transport may differ, and a loop that is late sends command and position late alike.
        is_stamped = bool(np.any(other.stamps_ns != NO_STAMP))
        times = stamped(other)[0] if is_stamped else other.arrivals_ns
        value_at = _held if item.between == "hold" else _between
        raw[key] = value_at(times, other.values[key], stamps_ns if is_stamped else arrivals)
    return raw


def _held(
    times: NDArray[np.int64], values: NDArray[np.float64], at: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the latest value at some times; not a number before the first."""
    if not len(times):
        return np.full(len(at), np.nan)
    order = np.argsort(times, kind="stable")
    index = np.searchsorted(times[order], at, side="right") - 1
    return np.where(index < 0, np.nan, values[order][np.maximum(index, 0)])


def _between(
    times: NDArray[np.int64], values: NDArray[np.float64], at: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return values on the line between samples; not a number outside of them and in gaps."""
    if len(times) < 2:
        return np.full(len(at), np.nan)
    order = np.argsort(times, kind="stable")
    times, values = times[order], values[order]
    right = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    width = times[right] - times[right - 1]
    usual = max(float(np.median(np.diff(times))), 1.0)
    known = (at >= times[0]) & (at <= times[-1]) & (width <= _WIDEST * usual)
    own = (times - times[0]).astype(float)
    return np.where(known, np.interp((at - times[0]).astype(float), own, values), np.nan)
