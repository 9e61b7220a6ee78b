"""Readers of data sets, and a synthetic one: frames and object models."""
