# SPDX-License-Identifier: Apache-2.0
"""Running of nodes as processes."""
