"""Directories of certificates: what is wrong with one is said, and no secret with it."""

from __future__ import annotations

import shutil
from datetime import timedelta
from pathlib import Path

import pytest
from support.certificates.laboratory import DAY, laboratory

from hoap3.protocol.errors import ConfigError
from hoap3.protocol.secure.access import Access, read_access
from hoap3.protocol.secure.credentials import read_credentials
from hoap3.tools.services.certificates import init, issue


@pytest.fixture(scope="module")
def certs(tmp_path_factory) -> Path:
    folder = laboratory(tmp_path_factory.mktemp("lab") / "certs")
    issue(folder, "old", "observer", [], timedelta(seconds=-1))
    other = tmp_path_factory.mktemp("other")
    init(other, DAY)
    shutil.copy(other / "ca.pem", folder / "other_ca.pem")
    return folder


@pytest.fixture
def own(certs, tmp_path) -> Path:
    return Path(shutil.copytree(certs / "anna", tmp_path / "anna"))


def test_a_certificate_says_who_and_what_its_holder_is(certs):
    found = read_credentials(certs / "anna")
    assert (found.name, found.role) == ("anna", "operator")
    assert found.session_name("7") == "anna.7"


def test_of_tls_nothing_is_left_to_the_defaults(certs):
    tls = read_credentials(certs / "arm").tls()
    wanted = ("enable_mtls", "verify_name_on_connect", "close_link_on_expiration")
    assert all(tls[each] is True for each in wanted)


@pytest.mark.parametrize("name", ["ca.pem", "cert.pem", "key.pem"])
@pytest.mark.parametrize("content", [None, b"", b"-----BEGIN SECRET-----"])
def test_a_file_that_is_missing_or_none_is_named(name, content, own):
    (own / name).unlink()
    if content is not None:
        (own / name).write_bytes(content)
    with pytest.raises(ConfigError) as error:
        read_credentials(own)
    assert error.value.file == str(own / name)
    assert "SECRET" not in str(error.value)


def test_a_key_that_others_can_read_is_refused(own):
    (own / "key.pem").chmod(0o640)
    with pytest.raises(ConfigError, match="chmod 600"):
        read_credentials(own)


@pytest.mark.parametrize(
    ("source", "target"), [("otto/key.pem", "key.pem"), ("other_ca.pem", "ca.pem")]
)
def test_what_does_not_belong_together_is_refused(source, target, certs, own):
    shutil.copy(certs / source, own / target)
    with pytest.raises(ConfigError, match=target):
        read_credentials(own)


def test_an_expired_one_is_refused_with_the_remedy(certs):
    with pytest.raises(ConfigError, match="hoap3 certs renew old"):
        read_credentials(certs / "old")


def test_a_list_gives_each_name_one_role(tmp_path):
    (tmp_path / "access.yaml").write_text("controllers: [qp]\nadmins: [qp]\n")
    with pytest.raises(ConfigError, match="qp"):
        read_access(tmp_path)


def test_a_list_without_names_is_of_nobody(tmp_path):
    (tmp_path / "access.yaml").write_text("controllers: [qp]\noperators:\nadmins:\n")
    assert read_access(tmp_path).roles == {"qp": "controller"}


@pytest.mark.parametrize("name", ["a.b", "A", "", "*", "a/b", "x" * 33])
def test_a_list_holds_names_that_no_key_can_mistake(name, tmp_path):
    (tmp_path / "access.yaml").write_text(f"controllers: ['{name}']\n")
    with pytest.raises(ConfigError, match="controllers"):
        read_access(tmp_path)


def test_a_list_survives_being_written_and_changed(tmp_path):
    access = Access(controllers=("qp",)).with_name("anna", "operator").with_name("o", "observer")
    (tmp_path / "access.yaml").write_text(access.without("o").to_yaml())
    assert read_access(tmp_path).roles == {"qp": "controller", "anna": "operator"}
