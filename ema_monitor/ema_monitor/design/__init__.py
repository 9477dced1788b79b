# SPDX-License-Identifier: Apache-2.0
"""Design and assessment of tests before they are run: which faults a motion shows, and how well."""
