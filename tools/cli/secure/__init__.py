"""Commands of the secure profile."""
