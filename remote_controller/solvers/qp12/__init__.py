"""QP12 in closed form, with and without bounds, and its peers."""
