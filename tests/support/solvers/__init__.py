"""Solvers as tests call them."""
