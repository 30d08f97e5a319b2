"""Proofs of what the product runs: its authority by search, its filters by theorem provers."""
