"""The papers: one module each, or one folder, with one function.

    remake(say: Callable[[str], None]) -> tuple[list[Figure], list[Row]]

It does the experiments, says what it is at, and leaves drawing and judging to others. The module's
name is what `hoap3 reproduce` calls the paper; nothing else has to be told of it.
"""
