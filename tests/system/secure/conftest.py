"""A robot with certificates, for the tests of a module."""

from support.certificates.secured_arm import certs, secured

__all__ = ["certs", "secured"]
