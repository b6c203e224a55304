"""One quantity measured over another: what several plans of the paper's figures have in common."""
