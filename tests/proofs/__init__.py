"""Prove who may command the robot, and what its filters let through, over the code that it runs.

    python -m tests.proofs authority|filter|jerk [--json]

Authority is searched exhaustively; the filters are proved by z3, in few bits, and compiled.
"""
