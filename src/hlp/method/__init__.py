"""Learn objects from CAD models and find them in one RGB-D frame: arrays in, poses out."""
