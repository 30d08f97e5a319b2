"""A described robot as numbers: Pinocchio model, dynamics, bounds that keep its limits."""
