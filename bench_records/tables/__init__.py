"""Reads tables of samples from other programs, as CSV, Parquet, Arrow or MDF. An ambiguous table is refused."""
