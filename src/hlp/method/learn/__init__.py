"""Learns objects from their CAD models: views, networks, codebooks, scores, one folder."""
