"""Compiles every kernel once, two at a time, each after those that it is made of."""

from __future__ import annotations

import ast
import importlib
import multiprocessing
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from graphlib import TopologicalSorter
from pathlib import Path

from support import HOUSE

ROOMS = ("protocol", "remote_controller", "robot_emulator")
AT_ONCE = 2


def kernel_modules() -> dict[str, set[str]]:
    """Modules of kernels, and which others of them each one imports."""
    files = {
        ".".join(("hoap3", *path.relative_to(HOUSE).with_suffix("").parts)): path
        for room in ROOMS
        for path in sorted((HOUSE / room).rglob("*_kernels.py"))
    }
    return {name: _imported(path) & files.keys() for name, path in files.items()}


def compile_all(modules: dict[str, set[str]]) -> None:
    """Compile modules of kernels; raises what the first one that fails raises."""
    order = TopologicalSorter(modules)
    order.prepare()
    running: dict[Future[None], str] = {}
    with ProcessPoolExecutor(AT_ONCE, multiprocessing.get_context("fork")) as pool:
        while order.is_active():
            running |= {pool.submit(_compile, name): name for name in order.get_ready()}
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                future.result()
                order.done(running.pop(future))


def _compile(name: str) -> None:
    importlib.import_module(name)


def _imported(path: Path) -> set[str]:
    statements = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    return {each.module for each in statements if isinstance(each, ast.ImportFrom) and each.module}
