"""Pictures of the commands, in the style of ``ema_monitor.plot``."""
