"""Tasks of a log's config, anew: errors, Jacobians and targets in plain numpy with Pinocchio."""
