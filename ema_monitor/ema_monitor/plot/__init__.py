"""Pictures of an identification. They need matplotlib (``pip install ema_monitor[plot]``)."""

from ema_monitor.plot.fit import plot_fit

__all__ = ["plot_fit"]
