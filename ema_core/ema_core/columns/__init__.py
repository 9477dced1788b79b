# SPDX-License-Identifier: Apache-2.0
"""Wrong telemetry columns: which measured relations show an error, and which mistake explains it.

Callers measure the relations from their own data and word the result. The decisions are here:

- ``mistakes``: common mistakes that multiply a column by a factor
- ``errors``: wrong columns as values; ``wording`` formats them as text
- ``tolerances``: thresholds of all relations
- ``of_window``: position, command, speed and inertia in a window, of a unit that may be faulty
- ``of_current``: current, compared with acceleration and friction of an imported recording
- ``of_model``: a column, compared with the response of the described actuator
- ``of_records``: speed and effort, compared with the healthy records of the unit
- ``frozen``, ``repetition``, ``wraps``: columns that are constant, repeat values, or wrap

Two decisions are elsewhere. `ema_bags.inputs.factors` searches the entries of a mapping.
`ema_bags.inputs.commanded` detects setpoints by their residual.
"""
