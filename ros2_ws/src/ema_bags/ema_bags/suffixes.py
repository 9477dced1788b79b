"""Suffixes by which recordings are recognised."""

from typing import Final

PARQUET: Final = (".parquet", ".pq")
"""Parquet files."""

TABLES: Final = (".csv", *PARQUET)
"""Tables; ``ema import`` also reads any file that is neither Parquet nor a bag as CSV."""

MCAP: Final = ".mcap"
"""Bag in MCAP storage."""

SQLITE: Final = ".db3"
"""Bag in sqlite3 storage, which ``ema import`` converts."""

BAGS: Final = (MCAP, SQLITE)
"""Files of bags."""
