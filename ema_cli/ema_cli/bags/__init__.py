# SPDX-License-Identifier: Apache-2.0
"""Reading of bags for the commands."""
