"""Reader of tables of samples from other programs, as CSV, Parquet, Arrow or MDF; refuses an ambiguous table."""
