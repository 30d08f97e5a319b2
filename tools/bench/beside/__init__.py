"""`hoap3 bench beside`: what something that runs beside a robot adds to its misses.

`race` runs pairs with and without it, `clients` is one such thing, `show` prints the table.
"""
