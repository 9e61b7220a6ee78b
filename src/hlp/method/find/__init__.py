"""Finds learnt objects in one frame: windows, votes, hypotheses, refined poses."""
