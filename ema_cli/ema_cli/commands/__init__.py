# SPDX-License-Identifier: Apache-2.0
"""Commands of ``ema``, one module each."""
