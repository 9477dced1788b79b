# SPDX-License-Identifier: Apache-2.0
"""Pictures of the commands, in the style of ``ema_monitor.plot``."""
