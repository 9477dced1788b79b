# SPDX-License-Identifier: Apache-2.0
"""Fault growth: measurement, tracking and extrapolation."""
