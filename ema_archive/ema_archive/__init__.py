# SPDX-License-Identifier: Apache-2.0
"""Archive: estimates, health and life from the bags of a fleet, stored as tables."""
