"""A small certificate authority for a laboratory."""
