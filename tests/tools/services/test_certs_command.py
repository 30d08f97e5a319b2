"""`hoap3 certs` as people use it: what it prints, and what it never does."""

from __future__ import annotations

import json
import sys

import pytest

from hoap3.tools.cli.app import main


@pytest.fixture
def hoap3(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["hoap3", *words])
        with pytest.raises(SystemExit) as end:
            main()
        printed = capsys.readouterr()
        return int(end.value.code or 0), printed.out, printed.err

    return run


def test_results_go_to_standard_output_and_no_secret_anywhere(hoap3, tmp_path):
    printed = []
    for words in (
        ("init",),
        ("issue", "arm", "--role", "robot", "--host", "192.168.1.10"),
        ("issue", "anna", "--role", "operator"),
        ("renew", "anna"),
        ("list",),
        ("revoke", "anna"),
    ):
        code, out, err = hoap3("certs", *words)
        assert code == 0, err
        printed.append((out, err))
    out, err = printed[2]
    assert out == "certs/anna\n"
    assert "certs/arm/access.yaml" in err
    everything = "".join(map("".join, printed))
    for file in tmp_path.rglob("*.key"), tmp_path.rglob("key.pem"):
        for path in file:
            secret = path.read_text().splitlines()[1]
            assert secret not in everything
    _, out, _ = hoap3("certs", "list", "--json")
    found = {each["name"]: each["state"] for each in json.loads(out)["certificates"]}
    assert found == {"arm": "valid", "anna": "revoked"}


@pytest.mark.parametrize(
    "words", [("list",), ("issue", "a", "--role", "observer"), ("renew", "a"), ("revoke", "a")]
)
def test_without_an_authority_everything_says_how_to_begin(words, hoap3):
    code, out, err = hoap3("certs", *words)
    assert (code, out) == (2, "")
    assert "hoap3 certs init" in err


def test_revoking_ends_with_a_finding_where_a_list_is_left(hoap3, tmp_path):
    for words in (("init",), ("issue", "arm", "--role", "robot")):
        assert hoap3("certs", *words)[0] == 0
    hoap3("certs", "issue", "anna", "--role", "operator")
    file = tmp_path / "certs" / "arm" / "access.yaml"
    file.unlink()
    code, out, err = hoap3("certs", "revoke", "anna")
    assert (code, out) == (1, "anna: revoked\n")
    assert "certs/arm/access.yaml" in err


def test_stopping_with_an_observers_certificate_is_refused_before_anything_is_sent(hoap3):
    hoap3("certs", "init")
    hoap3("certs", "issue", "otto", "--role", "observer")
    code, _, err = hoap3("stop", "arm", "--secure", "certs/otto")
    assert code == 2
    assert "observer" in err
    assert "operator, admin" in err
