"""Cameras for `hlp live`: sources of RGB-D images that come one after another."""
