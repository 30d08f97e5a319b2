"""References through points at times: files, polynomials between the points, tolerances."""
