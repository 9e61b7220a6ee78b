"""Learn objects from CAD models; find them in one RGB-D frame: arrays in, poses out."""
