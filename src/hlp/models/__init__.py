"""Networks with their Lightning modules: the holistic classifier and the local encoders."""
