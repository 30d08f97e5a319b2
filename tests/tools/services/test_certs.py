"""The laboratory's authority: what it writes, who may read it, and what it never says."""

from __future__ import annotations

import errno
import stat
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    PrivateFormat,
    load_pem_private_key,
)
from support.certificates.laboratory import DAY, laboratory

from hoap3.protocol.errors import ConfigError, UsageError
from hoap3.protocol.secure.access import read_access
from hoap3.protocol.secure.credentials import read_credentials
from hoap3.tools.services import certificates as authority
from hoap3.tools.services.certificates import HOSTS, init, issue, read_register, renew, revoke


@pytest.fixture
def certs(tmp_path) -> Path:
    return laboratory(tmp_path / "certs")


def test_keys_are_their_owners_alone(certs):
    keys = [certs / "ca.key", *certs.glob("*/key.pem")]
    assert len(keys) == 7
    assert {stat.S_IMODE(path.stat().st_mode) for path in keys} == {0o600}
    assert {stat.S_IMODE(path.stat().st_mode) for path in certs.iterdir() if path.is_dir()} == {
        0o700
    }


def test_a_robots_list_has_everybody_whoever_came_first(certs):
    issue(certs, "late", "robot", [], DAY)
    issue(certs, "new", "observer", [], DAY)
    lists = [dict(read_access(certs / robot).roles) for robot in ("arm", "late")]
    assert lists[0] == lists[1]
    assert lists[0]["new"] == "observer"
    assert lists[0]["qp"] == "controller"


def test_revoking_takes_a_name_from_every_list_for_ever(certs):
    issue(certs, "late", "robot", [], DAY)
    revoke(certs, "qp")
    for robot in ("arm", "late"):
        assert "qp" not in read_access(certs / robot).roles
        assert "rival" in read_access(certs / robot).roles
    for act in (lambda: renew(certs, "qp", DAY), lambda: revoke(certs, "qp")):
        with pytest.raises(UsageError, match="qp"):
            act()
    with pytest.raises(UsageError, match="qp"):
        issue(certs, "qp", "controller", [], DAY)


def test_a_list_that_was_cut_by_hand_stays_so(certs):
    file = certs / "arm" / "access.yaml"
    file.write_text("controllers: [qp]\n")
    issue(certs, "new", "observer", [], DAY)
    assert read_access(certs / "arm").roles == {"qp": "controller", "new": "observer"}


def test_renewing_keeps_who_it_is_and_changes_the_key(certs):
    issue(certs, "far", "robot", ["robot.example", "192.168.1.10"], DAY)
    before = {name: (certs / "far" / name).read_bytes() for name in ("key.pem", "cert.pem")}
    renew(certs, "far", 2 * DAY)
    found = read_credentials(certs / "far")
    assert (found.name, found.role) == ("far", "robot")
    assert (certs / "far" / "key.pem").read_bytes() != before["key.pem"]
    assert hosts(certs / "far" / "cert.pem") >= {"robot.example", "192.168.1.10", "127.0.0.1"}
    assert read_register(certs).get("far").expires == found.expires.isoformat()


def test_renewing_gives_a_robot_other_hosts_and_keeps_those_of_its_own_machine(certs):
    issue(certs, "far", "robot", ["robot.example"], DAY)
    renew(certs, "far", DAY, ["192.168.1.20"])
    assert hosts(certs / "far" / "cert.pem") == {*HOSTS, "192.168.1.20"}
    for name, wanted in (("far", "a:7447"), ("qp", "192.168.1.20")):
        before = (certs / name / "cert.pem").read_bytes()
        with pytest.raises((ConfigError, UsageError), match="host"):
            renew(certs, name, DAY, [wanted])
        assert (certs / name / "cert.pem").read_bytes() == before


def test_revoking_goes_on_where_the_list_of_one_robot_is_gone(certs):
    issue(certs, "late", "robot", [], DAY)
    (certs / "arm" / "access.yaml").rename(certs / "elsewhere.yaml")
    changed, failed = revoke(certs, "qp")
    assert changed == [certs / "late" / "access.yaml"]
    assert "qp" not in read_access(certs / "late").roles
    assert len(failed) == 1
    assert str(certs / "arm" / "access.yaml") in failed[0]
    assert read_register(certs).find("qp").revoked


def test_issuing_goes_on_where_the_list_of_one_robot_is_gone(certs):
    issue(certs, "late", "robot", [], DAY)
    (certs / "arm" / "access.yaml").rename(certs / "elsewhere.yaml")
    place, changed, failed = issue(certs, "new", "observer", [], DAY)
    assert read_credentials(place).name == "new"
    assert changed == [certs / "late" / "access.yaml"]
    assert read_access(certs / "late").roles["new"] == "observer"
    assert len(failed) == 1
    assert str(certs / "arm" / "access.yaml") in failed[0]
    assert read_register(certs).find("new") is not None


def hosts(file: Path) -> set[str]:
    from cryptography import x509

    content = x509.load_pem_x509_certificate(file.read_bytes()).extensions
    names = content.get_extension_for_class(x509.SubjectAlternativeName).value
    return {str(each.value) for each in names}


def test_a_second_authority_takes_nobodys_place(certs):
    with pytest.raises(UsageError, match=str(certs)):
        init(certs, DAY)


@pytest.mark.parametrize("name", ["A", "a.b", "../a", "a b", "", "é"])
def test_a_name_is_one_that_keys_and_folders_can_have(name, certs):
    with pytest.raises(ConfigError):
        issue(certs, name, "observer", [], DAY)


@pytest.mark.parametrize("host", ["tcp/1.2.3.4", "a:7447", "", "*.lab", "ü.lab"])
def test_a_host_is_a_name_or_an_address(host, certs):
    with pytest.raises(ConfigError, match="host"):
        issue(certs, "far", "robot", [host], DAY)
    assert read_register(certs).find("far") is None


def test_only_robots_have_hosts_and_none_is_revoked(certs):
    with pytest.raises(UsageError, match="--host"):
        issue(certs, "new", "observer", ["lab"], DAY)
    with pytest.raises(UsageError, match="arm"):
        revoke(certs, "arm")


def test_without_an_authority_the_command_that_makes_one_is_named(tmp_path):
    with pytest.raises(UsageError, match="hoap3 certs init"):
        issue(tmp_path, "a", "observer", [], DAY)


def test_an_authority_that_was_cut_short_says_what_to_remove(tmp_path):
    certs = tmp_path / "certs"
    init(certs, DAY)
    (certs / "register.yaml").unlink()
    with pytest.raises(UsageError, match=r"ca\.key"):
        init(certs, DAY)
    (certs / "ca.key").unlink()
    init(certs, DAY)
    issue(certs, "anna", "operator", [], DAY)


def test_a_renewal_that_fails_leaves_a_pair_that_fits(certs, monkeypatch):
    before = {path.name: path.read_bytes() for path in (certs / "qp").iterdir()}

    def full(_: object) -> bytes:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(authority, "_pem", full)
    with pytest.raises(UsageError, match="No space left"):
        renew(certs, "qp", DAY)
    assert {path.name: path.read_bytes() for path in (certs / "qp").iterdir()} == before
    assert read_credentials(certs / "qp").name == "qp"


def test_who_has_moved_is_renewed_and_a_robot_needs_its_hosts(certs):
    for name in ("anna", "arm"):
        for path in (certs / name).iterdir():
            path.unlink()
    renew(certs, "anna", DAY)
    assert read_credentials(certs / "anna").role == "operator"
    with pytest.raises(UsageError, match="--host"):
        renew(certs, "arm", DAY)
    renew(certs, "arm", DAY, ["192.168.1.10"])
    assert hosts(certs / "arm" / "cert.pem") == {*HOSTS, "192.168.1.10"}


@pytest.mark.parametrize("content", [None, b"nonsense", "encrypted"])
def test_an_authoritys_key_that_cannot_be_used_is_named(content, certs):
    file = certs / "ca.key"
    key = load_pem_private_key(file.read_bytes(), None)
    file.unlink()
    if content == "encrypted":
        locked = BestAvailableEncryption(b"secret")
        content = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, locked)
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(UsageError, match=r"ca\.key"):
        issue(certs, "new", "observer", [], DAY)
    assert read_register(certs).find("new") is None


def test_a_name_that_a_list_has_can_be_revoked_whatever_failed(certs, monkeypatch):
    def fail(*_: object) -> object:
        raise KeyboardInterrupt

    monkeypatch.setattr(authority, "_change_lists", fail)
    with pytest.raises(KeyboardInterrupt):
        issue(certs, "new", "observer", [], DAY)
    monkeypatch.undo()
    revoke(certs, "new")
