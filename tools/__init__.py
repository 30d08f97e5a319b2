"""The command line, and what its commands compute, importable without a terminal."""
