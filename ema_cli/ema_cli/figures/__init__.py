# SPDX-License-Identifier: Apache-2.0
"""Pictures that commands draw, in the style of ``ema_monitor.plot``."""
