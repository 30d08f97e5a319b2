"""Converging to a curve and circulating it (QP12, section III-D.2)."""
