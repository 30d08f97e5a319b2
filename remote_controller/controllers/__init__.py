"""Controllers, one a file, all with the same three methods."""
