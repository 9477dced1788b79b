# SPDX-License-Identifier: Apache-2.0
"""Calibration: a model of the individual unit, fitted to healthy windows and stored."""
