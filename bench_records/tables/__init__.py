"""Reads tables of samples that other programs wrote, as CSV, Parquet, Arrow or MDF; refuses an ambiguous table."""
