"""Tables of samples that other programs wrote, as CSV, Parquet, Arrow or MDF: read, or refused, and never otherwise."""
