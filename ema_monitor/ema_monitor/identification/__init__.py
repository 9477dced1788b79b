# SPDX-License-Identifier: Apache-2.0
"""Identification of faults: from a window to an estimate with its uncertainty."""
