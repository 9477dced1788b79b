# SPDX-License-Identifier: Apache-2.0
"""Reading of bags and other recordings for the commands."""
