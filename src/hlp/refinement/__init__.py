"""Fine pose (stage 3): the cost of a pose against the observed depth, and its minimisation."""
