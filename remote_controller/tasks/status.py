"""What a task has to say of the present configuration, besides V.

Kernels take these numbers as constants, so this file counts as one of their sources.
"""

from __future__ import annotations

OK = 0
AT_ANTIPODE = 1
DEPENDENT_GRADIENTS = 2
TANGENT_TURNED = 3

NAMES = ("ok", "at_antipode", "dependent_gradients", "tangent_turned")
"""By number.

at_antipode: a frame is turned by half a turn from its target, where both ways round are equally
    short; one of them is taken.
dependent_gradients: the functions that define a curve no longer have independent gradients (or
    one of them is next to none); motion along the curve slows down to nothing.
tangent_turned: the tangent of a curve turned by more than 60° between two ticks; motion along
    the curve is held until it has turned back.
"""
