"""What people see: notes, progress, summary, verdicts, folders of results."""
