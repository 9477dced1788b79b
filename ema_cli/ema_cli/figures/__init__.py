"""Pictures that the commands draw; their style is that of ``ema_monitor.plot``."""
