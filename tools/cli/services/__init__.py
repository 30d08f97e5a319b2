"""Commands about services that run unattended."""
