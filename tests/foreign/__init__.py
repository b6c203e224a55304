"""Two rigs of strangers, written without a word of our table: a package, so that they run as programs too."""
