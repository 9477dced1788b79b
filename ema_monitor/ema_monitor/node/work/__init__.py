# SPDX-License-Identifier: Apache-2.0
"""Background threads of a monitor: estimates, prognoses and service calls."""
