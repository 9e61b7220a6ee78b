"""Runs and learnt objects in MLflow: its store, what a run logs, its pages, late uploads."""
