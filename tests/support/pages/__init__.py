"""Pages of the live page: a server for tests, what a page says, and a browser."""
