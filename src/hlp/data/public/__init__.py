"""Public data sets: where they lie, loading them, unpacking what was loaded."""
