"""Generators of tables in docs/: `python -m benchmarks.tables.NAME` writes one."""
