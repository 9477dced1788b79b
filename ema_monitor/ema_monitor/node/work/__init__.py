# SPDX-License-Identifier: Apache-2.0
"""Working part of a monitor: estimates, prognoses and service calls in separate threads."""
