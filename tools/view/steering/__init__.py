"""What a page may move, and how it lets go."""
