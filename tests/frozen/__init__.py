"""Compare the behaviour of two revisions: bytes of logs and complete JSON outputs.

    python -m tests.frozen --against REV [--quick]

Both revisions run the same commands on the same machine; no output is stored in the repository.
"""
