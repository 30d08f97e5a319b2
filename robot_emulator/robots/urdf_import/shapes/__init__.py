"""Meshes: where they are, how they are read, and what contains them."""
