"""Generalized hierarchical control, and the hierarchies that it is compared with."""
