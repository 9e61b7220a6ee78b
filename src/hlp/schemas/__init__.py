"""What files from outside must hold: one schema for each, read through one door."""
