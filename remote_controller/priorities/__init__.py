"""How much each task is kept out of the directions of each other, and how that changes."""
