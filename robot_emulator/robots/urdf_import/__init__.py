"""Vendors' URDFs as they are: read, made fit to travel, with everything that was guessed said."""
