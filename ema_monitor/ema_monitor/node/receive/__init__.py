# SPDX-License-Identifier: Apache-2.0
"""Receiving part of a monitor: turns accepted messages into windows, measurements and counts."""
