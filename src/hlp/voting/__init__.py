"""Votes of local patches for a pose, and the modes of those votes (paper, section 3.2)."""
