# SPDX-License-Identifier: Apache-2.0
"""Start, supervision and observation of nodes."""
