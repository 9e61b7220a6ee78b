"""One reproducible run: score, draw, log."""
