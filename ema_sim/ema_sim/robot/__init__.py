# SPDX-License-Identifier: Apache-2.0
"""Simulated robot arm: joints, their work, and its telemetry."""
