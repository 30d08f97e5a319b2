"""What became of each tick, where its time went, and who was to blame."""
