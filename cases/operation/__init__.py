"""Months of operational data: read in pieces from partitioned Parquet, and cut into windows."""
