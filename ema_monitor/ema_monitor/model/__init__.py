# SPDX-License-Identifier: Apache-2.0
"""Monitor model: a fast actuator model for estimation."""
