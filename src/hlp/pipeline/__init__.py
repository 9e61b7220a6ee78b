"""Stages in order: what each is made from, where its output is kept, and the run as a whole."""
