"""Robots that stand on their soles: cones of contact wrenches, and what their motion leaves free.

`wrench_cone` has the inequalities of one sole, `reduction` the free variables of a whole robot.
"""
