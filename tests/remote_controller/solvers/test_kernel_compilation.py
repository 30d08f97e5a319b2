"""Where machine code is kept, what it is named after, and what happens where it cannot be kept."""

from __future__ import annotations

import ast
import importlib
import os
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numba.core import sigutils

from hoap3.protocol.runtime import numba_jit

HOUSE = Path(numba_jit.__file__).resolve().parents[2]
TINY = """
from hoap3.protocol.runtime.numba_jit import inlined, kernel

@inlined
def twice(x):
    return 2.0 * x

@kernel()
def quadruple(x: float) -> float:
    return twice(twice(x))
"""
PAIR = """
from typing import NamedTuple
from hoap3.protocol.runtime.numba_jit import Vector, kernel

class Pair(NamedTuple):
    values: Vector
    factor: float

@kernel()
def inner(pair: Pair) -> float:
    return pair.factor * pair.values.sum()

@kernel()
def outer(values: Vector, factor: float) -> float:
    return inner(Pair(values, factor))
"""
PROBE = """
from hoap3.protocol.runtime import numba_jit
import numpy as np
from hoap3.remote_controller.solvers import Qp12
u = np.zeros(2)
Qp12(2).solve(np.array([2.0, -1.0]), 1.0, 0.0, u)
print(numba_jit.CACHE_DIRECTORY)
print(*u)
"""


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder on the import path with one kernel module, and a cache beside it."""
    (tmp_path / "tiny_kernels.py").write_text(TINY)
    (tmp_path / "cache").mkdir(mode=0o700)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(numba_jit, "CACHE_DIRECTORY", tmp_path / "cache")
    monkeypatch.delitem(sys.modules, "tiny_kernels", raising=False)
    return tmp_path


def quadruple_of_3() -> float:
    sys.modules.pop("tiny_kernels", None)
    return float(importlib.import_module("tiny_kernels").quadruple(3.0))


def probe(**environment: str | None) -> tuple[Path, str]:
    """Cache directory and answer of a fresh process; None takes a variable away."""
    merged = {**os.environ, **environment}
    done = subprocess.run(
        [sys.executable, "-c", PROBE],
        env={name: value for name, value in merged.items() if value is not None},
        capture_output=True,
        text=True,
        check=True,
    )
    directory, answer = done.stdout.splitlines()
    return Path(directory), answer


def unseen_sources(text: str) -> set[str]:
    """Names from modules of ours outside the fingerprint that a kernel module computes with."""
    imported, computed = set(), set()
    pending: list[ast.AST] = [ast.parse(text)]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.ImportFrom):
            module = node.module or ""
            covered = module.endswith(("_kernels", ".status", "hoap3.protocol.runtime.numba_jit"))
            if module.split(".")[0] == "hoap3" and not covered:
                imported.update(alias.asname or alias.name for alias in node.names)
        elif isinstance(node, ast.Import):
            imported.update(a.name for a in node.names if a.name.split(".")[0] == "hoap3")
        elif isinstance(node, ast.Name):
            computed.add(node.id)
        pending += [
            child
            for field, value in ast.iter_fields(node)
            if field not in {"annotation", "returns"}
            for child in (value if isinstance(value, list) else [value])
            if isinstance(child, ast.AST)
        ]
    return {name for name in imported if name.split(".")[0] in computed}


class TestDirectory:
    """The choice of the directory."""

    def test_is_private_and_named_by_the_fingerprint(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        monkeypatch.setenv("HOAP3_CACHE_DIR", str(tmp_path / "deep" / "down"))
        found = numba_jit.cache_directory()
        assert found == tmp_path / "deep" / "down" / f"kernels-{numba_jit.fingerprint()}"
        assert stat.S_IMODE(found.stat().st_mode) == 0o700
        assert found.stat().st_uid == os.geteuid()

    def test_follows_xdg_then_home(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.delenv("HOAP3_CACHE_DIR", raising=False)
        monkeypatch.setenv("HOME", str(tmp_path / "home"))
        for xdg, base in ((str(tmp_path / "xdg"), "xdg"), ("relative", "home/.cache"), ("", None)):
            monkeypatch.setenv("XDG_CACHE_HOME", xdg)
            found = numba_jit.cache_directory()
            assert found is not None
            assert found.parent == tmp_path / (base or "home/.cache") / "hoap3"

    @pytest.mark.parametrize("spoil", ["open to others", "a link", "a file", "somebody else's"])
    def test_is_not_shared(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, spoil: str
    ) -> None:
        monkeypatch.setenv("HOAP3_CACHE_DIR", str(tmp_path))
        wanted = tmp_path / f"kernels-{numba_jit.fingerprint()}"
        if spoil == "open to others":
            wanted.mkdir()
            wanted.chmod(0o755)
        elif spoil == "a link":
            (tmp_path / "elsewhere").mkdir(mode=0o700)
            wanted.symlink_to(tmp_path / "elsewhere")
        elif spoil == "a file":
            wanted.touch()
        else:
            monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
        found = numba_jit.cache_directory()
        assert found is not None
        assert found.parent == Path(tempfile.gettempdir())
        assert stat.S_IMODE(found.stat().st_mode) == 0o700

    @pytest.mark.parametrize("home", ["/dev/null", "~"])
    def test_is_temporary_without_a_usable_home(
        self, monkeypatch: pytest.MonkeyPatch, home: str
    ) -> None:
        for name in ("HOAP3_CACHE_DIR", "XDG_CACHE_HOME"):
            monkeypatch.delenv(name, raising=False)
        monkeypatch.setenv("HOME", home)
        found = numba_jit.cache_directory()
        assert found is not None
        assert found.parent == Path(tempfile.gettempdir())

    def test_is_none_where_nothing_can_be_written(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("HOAP3_CACHE_DIR", "/dev/null")
        monkeypatch.setattr(tempfile, "tempdir", "/dev/null")
        assert numba_jit.cache_directory() is None


class TestFingerprint:
    """What the directory is named after."""

    def test_follows_every_source_of_a_kernel(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        for room in numba_jit.ROOMS:
            (tmp_path / room / "inner").mkdir(parents=True)
        (tmp_path / "protocol/runtime").mkdir()
        monkeypatch.setattr(numba_jit, "__file__", str(tmp_path / "protocol/runtime/numba_jit.py"))
        monkeypatch.setattr(numba_jit, "HOUSE", tmp_path)
        seen = set()
        for name in (
            "protocol/runtime/numba_jit.py",
            "protocol/x_kernels.py",
            "remote_controller/inner/x_kernels.py",
            "remote_controller/inner/y_kernels.py",
            "remote_controller/inner/status.py",
            "robot_emulator/x_kernels.py",
            "tools/x_kernels.py",
        ):
            for text in ("a = 1", "a = 2"):
                (tmp_path / name).write_text(text)
                seen.add(numba_jit.fingerprint())
        assert len(seen) == 14
        (tmp_path / "tools/kernels_not.py").write_text("a = 1")
        assert numba_jit.fingerprint() in seen

    def test_follows_numba_and_the_processor(self, monkeypatch: pytest.MonkeyPatch) -> None:
        seen = {numba_jit.fingerprint()}
        monkeypatch.setattr(numba, "__version__", "0.0")
        seen.add(numba_jit.fingerprint())
        monkeypatch.setattr(numba.config, "CPU_NAME", "generic")
        seen.add(numba_jit.fingerprint())
        assert len(seen) == 3

    def test_sees_everything_that_kernels_take_from_our_packages(self) -> None:
        """A constant from any other module would be frozen into stale machine code."""
        for room in numba_jit.ROOMS:
            for path in (HOUSE / room).rglob("*_kernels.py"):
                assert not unseen_sources(path.read_text()), path

    def test_would_miss_a_constant_from_elsewhere(self) -> None:
        line = "from hoap3.tools.constants import LIMIT\n"
        assert unseen_sources(line + "def f(x):\n    return x + LIMIT") == {"LIMIT"}
        assert not unseen_sources(line + "def f(x: LIMIT) -> LIMIT:\n    return x")


class TestKernel:
    """The decorators."""

    def test_compiles_into_our_directory_only(self, tiny: Path) -> None:
        before = numba.config.CACHE_DIR
        assert quadruple_of_3() == 12.0
        assert {path.suffix for path in (tiny / "cache").rglob("*.nb*")} == {".nbi", ".nbc"}
        assert not list(tiny.glob("__pycache__/*.nb*"))
        assert before == numba.config.CACHE_DIR

    def test_is_loaded_not_compiled_the_second_time(self, tiny: Path) -> None:
        quadruple_of_3()
        stamps = {path: path.stat().st_mtime_ns for path in (tiny / "cache").rglob("*.nb*")}
        assert quadruple_of_3() == 12.0
        kernel = sys.modules["tiny_kernels"].quadruple
        assert sum(kernel.stats.cache_hits.values()) == 1
        assert stamps == {p: p.stat().st_mtime_ns for p in (tiny / "cache").rglob("*.nb*")}

    @pytest.mark.parametrize("theirs", [False, True])
    def test_is_shared_by_installations_but_for_other_peoples_files(
        self, monkeypatch: pytest.MonkeyPatch, tiny: Path, theirs: bool
    ) -> None:
        hits = []
        for name in ("wheel", "editable"):
            folder = tiny / name / ("elsewhere" if theirs else "tools")
            folder.mkdir(parents=True)
            (folder / "tiny_kernels.py").write_text(TINY)
            monkeypatch.setattr(numba_jit, "HOUSE", tiny / name)
            monkeypatch.syspath_prepend(folder)
            assert quadruple_of_3() == 12.0
            hits.append(sum(sys.modules["tiny_kernels"].quadruple.stats.cache_hits.values()))
        assert hits == [0, 0 if theirs else 1]

    @pytest.mark.slow
    @pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
    @pytest.mark.parametrize("length", [0, 40])
    def test_survives_a_file_cut_off_by_a_power_cut(
        self, tiny: Path, suffix: str, length: int
    ) -> None:
        quadruple_of_3()
        for path in (tiny / "cache").rglob(f"*{suffix}"):
            path.write_bytes(path.read_bytes()[:length])
        assert quadruple_of_3() == 12.0

    def test_survives_a_directory_that_cannot_be_written_any_more(
        self, monkeypatch: pytest.MonkeyPatch, tiny: Path
    ) -> None:
        def full(*args: object, **kwargs: object) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("numba.core.caching.IndexDataCacheFile.save", full)
        assert quadruple_of_3() == 12.0

    def test_works_without_any_directory(self, monkeypatch: pytest.MonkeyPatch, tiny: Path) -> None:
        monkeypatch.setattr(numba_jit, "CACHE_DIRECTORY", None)
        assert quadruple_of_3() == 12.0
        assert not list(tiny.rglob("*.nb*"))

    def test_refuses_what_it_was_not_compiled_for(self, tiny: Path) -> None:
        quadruple_of_3()
        with pytest.raises(TypeError):
            sys.modules["tiny_kernels"].quadruple("3")

    @pytest.mark.slow
    def test_asks_who_makes_arrays_to_say_so(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(numba_jit, "CACHE_DIRECTORY", None)

        def zeros(n: int) -> float:
            return float(np.zeros(n).sum())

        def copies(a: object, b: object) -> None:
            a[:] = b  # type: ignore[index]

        for signature, function in (("f8(i8)", zeros), ("void(f8[::1], f8[::1])", copies)):
            with pytest.raises(numba.core.errors.NumbaError) as error:
                numba_jit.kernel(signature)(function)
            assert "allocates=True" in error.value.__notes__[0]
            numba_jit.kernel(signature, allocates=True)(function)

    def test_refuses_to_return_a_part_of_an_array_as_the_whole(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(numba_jit, "CACHE_DIRECTORY", None)

        def parts(x: Any) -> tuple[Any, Any]:
            return x[2:], x[:1]

        with pytest.raises(TypeError, match="allocates=True"):
            numba_jit.kernel("UniTuple(f8[::1], 2)(f8[::1])")(parts)
        lent = numba_jit.kernel("UniTuple(f8[::1], 2)(f8[::1])", allocates=True)(parts)
        assert [len(part) for part in lent(np.ones(5))] == [3, 1]

    def test_takes_its_signature_from_annotations_and_names_what_is_none(self) -> None:
        def mixed(x: numba_jit.Matrix, k: int) -> tuple[float, bool]:
            return x[k, 0], k > 0

        expected = sigutils.normalize_signature("Tuple((f8, b1))(f8[:,::1], i8)")
        assert sigutils.normalize_signature(numba_jit.signature_of(mixed)) == expected
        mixed.__annotations__["k"] = str
        with pytest.raises(TypeError, match=r"mixed.*str"):
            numba_jit.signature_of(mixed)

    @pytest.mark.slow
    def test_hands_over_what_belongs_together_as_one(self, tiny: Path) -> None:
        (tiny / "pair_kernels.py").write_text(PAIR)
        use = "import numpy as np, pair_kernels as p; print(p.outer(np.arange(3.0), 2.0)); "
        use += "print(len(p.inner.stats.cache_hits), len(p.outer.stats.cache_hits))"
        path = os.pathsep.join([str(tiny), *filter(None, [os.environ.get("PYTHONPATH")])])
        merged = {**os.environ, "PYTHONPATH": path, "HOAP3_CACHE_DIR": str(tiny / "cache")}
        for hits in ("0 0", "1 1"):  # compiled, then loaded from the cache
            done = subprocess.run(
                [sys.executable, "-c", use], env=merged, check=True, capture_output=True, text=True
            )
            assert done.stdout.splitlines() == ["6.0", hits]

    @pytest.mark.parametrize("option", ["fastmath", "parallel"])
    def test_refuses_options_that_change_bits(self, option: str) -> None:
        with pytest.raises(TypeError, match=option):
            numba_jit.kernel("f8(f8)", **{option: True})


def test_warm_up_names_each_module_before_it_is_imported(tiny: Path) -> None:
    (tiny / "tinier_kernels.py").write_text(TINY)
    told = []

    def report(name: str) -> None:
        told.append((name, "tiny_kernels" in sys.modules, "tinier_kernels" in sys.modules))

    sys.modules.pop("tinier_kernels", None)
    numba_jit.warm_up(["tiny_kernels", "tinier_kernels"], report)
    assert told == [("tiny_kernels", False, False), ("tinier_kernels", True, False)]
    assert "tinier_kernels" in sys.modules
    numba_jit.warm_up(["tiny_kernels"])


@pytest.mark.slow
def test_a_process_without_home_or_cache_solves_and_cleans_up(tmp_path: Path) -> None:
    directory, answer = probe(
        HOME="/dev/null", XDG_CACHE_HOME=None, HOAP3_CACHE_DIR=None, TMPDIR=str(tmp_path)
    )
    assert answer == "-0.4 0.2"
    assert directory.parent == tmp_path
    assert not directory.exists()


def test_a_process_without_the_variable_home_solves() -> None:
    _, answer = probe(HOME=None, NUMBA_DISABLE_JIT="1")
    assert answer == "-0.4 0.2"
