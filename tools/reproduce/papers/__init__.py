"""The papers: one module or folder each, with one function.

    remake(say: Callable[[str], None]) -> tuple[list[Figure], list[Row]]

It does the experiments and reports progress. The module's name is the paper's name for
`hoap3 reproduce`.
"""

from __future__ import annotations

from collections.abc import Callable

from hoap3.tools.reproduce.figures import Figure
from hoap3.tools.reproduce.rows import Row

Say = Callable[[str], None]
Made = tuple[list[Figure], list[Row]]
