# SPDX-License-Identifier: Apache-2.0
"""Duty of a unit: its measurement, the damage it causes, and future duties."""
