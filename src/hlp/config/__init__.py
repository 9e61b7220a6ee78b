"""Composed configuration in, checked and typed objects out."""
