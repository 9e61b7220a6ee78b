"""Figures of results, and pictures of what the stages see."""
