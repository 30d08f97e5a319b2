"""Distances between bodies, and the rows that keep them."""
