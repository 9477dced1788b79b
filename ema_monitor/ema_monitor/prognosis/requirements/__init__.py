# SPDX-License-Identifier: Apache-2.0
"""Performance requirements and prediction of their failure."""
