"""Certified gains of prioritised tasks, by an interior-point method of our own."""
