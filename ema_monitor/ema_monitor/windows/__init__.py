# SPDX-License-Identifier: Apache-2.0
"""Extraction and checking of telemetry windows, and band limitation of residuals."""
