"""Constraints: rows of A(q)u ≤ b(q), of C(q)u = c(q), and bounds on u (QP12, section III-E)."""
