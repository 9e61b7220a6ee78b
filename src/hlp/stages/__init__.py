"""Run the method over a data set; each output is made once, on disk."""
