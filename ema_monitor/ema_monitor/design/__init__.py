"""Judging and designing tests before any is made: which faults a motion shows, and how well."""
