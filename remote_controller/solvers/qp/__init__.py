"""Quadratic programs: our dual active set, and solvers of others behind one call."""
