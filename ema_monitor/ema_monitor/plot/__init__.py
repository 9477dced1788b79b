# SPDX-License-Identifier: Apache-2.0
"""Figures of an estimate. They need matplotlib (``pip install ema_monitor[plot]``)."""

from ema_monitor.plot.fit import plot_fit

__all__ = ["plot_fit"]
