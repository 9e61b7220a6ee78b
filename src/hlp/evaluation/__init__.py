"""Pose errors, verdicts on targets, recalls with confidence intervals, causes of misses."""
