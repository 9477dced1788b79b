# SPDX-License-Identifier: Apache-2.0
"""Fault growth from test to test, and prediction of the remaining useful life."""
