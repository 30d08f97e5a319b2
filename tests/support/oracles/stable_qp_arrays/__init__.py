"""Problem (3) of each cycle of `stable_qp`, and whether its answer is the optimum."""
