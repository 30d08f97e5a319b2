"""Filters between setpoints and the plant: limits, loss policy, safe stop."""
