"""Templates of gradient directions: coarse poses from outlines and inner edges."""
