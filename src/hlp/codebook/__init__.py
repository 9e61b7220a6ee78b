"""Codebook of local features and the search for nearest neighbours in it (paper, section 3.2)."""
