"""Turns the composed configuration into checked, typed objects."""
