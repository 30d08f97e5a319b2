"""Logs: written crash-safe, read however they ended, repaired, exported, replayed."""
