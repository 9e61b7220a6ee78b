"""Errors of poses, verdicts on targets, recalls with confidence intervals."""
