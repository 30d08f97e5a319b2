"""The general problem (3) of QP12: largest feasible decrease, objective, proof."""
