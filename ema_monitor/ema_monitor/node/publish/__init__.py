# SPDX-License-Identifier: Apache-2.0
"""Publishing of a monitor: estimates, health, status and log."""
