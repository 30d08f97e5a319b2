"""Property suites for what you write."""
