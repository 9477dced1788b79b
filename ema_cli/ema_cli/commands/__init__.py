# SPDX-License-Identifier: Apache-2.0
"""Commands of ``ema``, with a module for each command."""
