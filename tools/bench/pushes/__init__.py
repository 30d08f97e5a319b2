"""`hoap3 bench pushes`: how hard a standing robot may be pushed.

`capture` has the bounds, `trials` pushes, `show` prints the table.
"""
