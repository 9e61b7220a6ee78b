"""The page of a run or a sweep: one HTML file that needs no network and no other file."""
