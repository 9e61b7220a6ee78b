"""Measure the method: oracle, basin, benchmark, search, sweep."""
