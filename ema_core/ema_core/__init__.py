# SPDX-License-Identifier: Apache-2.0
"""Numerics and data types shared by simulator and monitor."""

__version__ = "0.2.0"
