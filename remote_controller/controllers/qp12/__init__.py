"""Controllers that make V of one point decrease: qp12, and its peers pinv and osqp."""
