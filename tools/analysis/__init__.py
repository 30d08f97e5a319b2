"""Ticks, certificates, verdicts and summaries of runs, and reports of logs."""
