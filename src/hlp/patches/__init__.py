"""Holistic and local patches: where they lie, how they are cut, how training sets are made."""
