"""What is wrong with frames, data sets, learnt objects and the machine: one module per kind."""
