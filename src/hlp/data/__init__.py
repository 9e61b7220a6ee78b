"""Folders on disk (or generated worlds) to frames and object models."""
