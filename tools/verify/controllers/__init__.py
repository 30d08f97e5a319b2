"""What each family of controllers claims, recomputed in plain numpy; one family a file."""
