# SPDX-License-Identifier: Apache-2.0
"""Comparison of any machine with its own healthy records, by inverse dynamics."""
