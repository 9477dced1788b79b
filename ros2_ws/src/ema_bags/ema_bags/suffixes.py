# SPDX-License-Identifier: Apache-2.0
"""Suffixes by which recordings are recognised."""

from typing import Final

PARQUET: Final = (".parquet", ".pq")
"""Parquet files."""

ARCHIVES: Final = (".npz",)
"""NumPy archives of arrays."""

TABLES: Final = (".csv", *PARQUET, *ARCHIVES)
"""Tables; ``ema import`` also reads any other file that is not a bag as CSV."""

MCAP: Final = ".mcap"
"""Bag in MCAP storage."""

SQLITE: Final = ".db3"
"""Bag in sqlite3 storage, which ``ema import`` converts."""

BAGS: Final = (MCAP, SQLITE)
"""Files of bags."""
