"""Reproduction of the thesis's optimizer study: runs, tables, figures and report."""
