"""Attacks on a robot, in plain and with certificates: they end as docs/security.md says."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from support import HOUSE
from support.attacks.attacks import ATTACKS
from support.attacks.doors import doors
from support.attacks.scene import Scene, attacked_laboratory
from support.certificates.laboratory import laboratory
from support.command_bench import free_port

NO_SESSION = ("nobody's certificate", "another authority's", "expired", "in plain")
LETS_IN = {"an observer": True, **dict.fromkeys(NO_SESSION, False)}


def rows() -> dict[str, dict[str, str]]:
    """How the page says that each attack ends, by what it is."""
    page = (HOUSE / "docs" / "security.md").read_text(encoding="utf-8")
    lines = page.partition("## Before and after")[2].partition("\n## ")[0].splitlines()
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if "|" in line]
    return {row[0]: dict(zip(cells[0], row, strict=True)) for row in cells[2:]}


ROWS = rows()


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    return attacked_laboratory(tmp_path_factory.mktemp("lab") / "certs")


@pytest.fixture(params=["plain", "with certificates"])
def how(request) -> str:
    return request.param


@pytest.fixture
def scene(how, certs) -> Iterator[Scene]:
    one = Scene(f"127.0.0.1:{free_port()}", None if how == "plain" else certs)
    yield one
    one.close()


def test_the_table_has_every_attack_that_is_run():
    assert list(ROWS) == list(ATTACKS)


@pytest.mark.slow
@pytest.mark.parametrize("attack", ATTACKS)
def test_an_attack_ends_as_the_page_says(attack, how, scene):
    assert ROWS[attack][how] == ("succeeds" if ATTACKS[attack](scene) else "refused")


@pytest.mark.slow
@pytest.mark.parametrize("how", ["with certificates"], indirect=True)
def test_who_has_no_valid_certificate_has_no_session(scene, certs, tmp_path):
    assert doors(scene.place, certs, laboratory(tmp_path / "other")) == LETS_IN
