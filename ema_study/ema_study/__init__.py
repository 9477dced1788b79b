# SPDX-License-Identifier: Apache-2.0
"""Reproduction of the thesis's optimizer study: runs, tables, figures and report."""
