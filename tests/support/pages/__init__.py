"""Pages in a browser, and servers of the live page."""
