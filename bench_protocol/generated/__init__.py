"""Files generated from the table of signals, for other tools: `make generate` writes them."""
