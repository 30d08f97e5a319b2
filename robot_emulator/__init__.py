"""A robot in software: it keeps its schedule, its limits and its word."""
