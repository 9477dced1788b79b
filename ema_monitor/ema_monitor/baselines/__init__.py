# SPDX-License-Identifier: Apache-2.0
"""Baselines of joints, collected record by record and accepted by a person or a rule."""
