"""Make, renew and revoke certificates; each gets a directory below the authority's.

Private keys are elliptic (P-256), readable by their owner alone, and are never printed. A robot's
directory also holds the list of whom it lets in, which `issue` and `revoke` keep. `register.yaml`
beside the authority's key lists what was issued.
"""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import yaml
from pydantic import Field

from hoap3.protocol.config.settings import RobotName, Settings, load_yaml, parse
from hoap3.protocol.errors import ConfigError, UsageError
from hoap3.protocol.secure.access import ACCESS_FILE, Access, read_access
from hoap3.protocol.secure.credentials import (
    CA_FILE,
    CERTIFICATE_FILE,
    KEY_FILE,
    check_installed,
)
from hoap3.protocol.secure.roles import Role
from hoap3.tools.logs.files import whole_file

REGISTER_FILE = "register.yaml"
SOON_DAYS = 30  # before its end, in which a certificate is said to expire soon


class Entry(Settings):
    """One certificate."""

    name: RobotName = Field(description="common name")
    role: Role = Field(description="what its holder may do")
    expires: str = Field(description="ISO 8601, UTC")
    revoked: bool = Field(False, description="whether its name has left the robots' lists")

    def state(self, now: datetime) -> str:
        """In a word: valid, expires soon, expired or revoked."""
        if self.revoked:
            return "revoked"
        days = (datetime.fromisoformat(self.expires) - now).total_seconds() / 86_400
        if days <= 0:
            return "expired"
        return "expires soon" if days < SOON_DAYS else "valid"

    def as_json(self) -> dict[str, str]:
        """For `hoap3 certs list --json`."""
        return {
            "name": self.name,
            "role": self.role,
            "expires": self.expires,
            "state": self.state(datetime.now(UTC)),
        }


class Register(Settings):
    """All of them, in the order in which they were issued."""

    certificates: tuple[Entry, ...] = ()

    def find(self, name: str) -> Entry | None:
        """The certificate of a name, if there is one."""
        return next((each for each in self.certificates if each.name == name), None)

    def get(self, name: str) -> Entry:
        """The certificate of a name that is in use.

        Raises:
            UsageError: there is none, or it was revoked.
        """
        entry = self.find(name)
        if entry is None:
            known = ", ".join(each.name for each in self.certificates) or "none"
            raise UsageError(f"no certificate is called {name!r}. Issued: {known}")
        if entry.revoked:
            raise UsageError(f"{name!r} was revoked: issue one under a new name")
        return entry

    def with_entry(self, entry: Entry) -> Register:
        """The same, with this certificate instead of the one of its name, or as the last."""
        if self.find(entry.name) is None:
            return Register(certificates=(*self.certificates, entry))
        others = [entry if each.name == entry.name else each for each in self.certificates]
        return Register(certificates=tuple(others))

    def to_yaml(self) -> str:
        """The content of a file."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False)


def read_register(folder: Path) -> Register:
    """What the authority in a folder has issued.

    Raises:
        UsageError: there is no authority.
        ConfigError: its register is wrong.
    """
    path = folder / REGISTER_FILE
    if not path.is_file():
        raise UsageError(f"{folder}: holds no authority. Run `hoap3 certs init --dir {folder}`")
    return parse(Register, load_yaml(path), str(path))


CA_KEY_FILE = "ca.key"
HOSTS = ("localhost", "127.0.0.1", "::1")  # at which a robot is reached on its own machine
FILES = (KEY_FILE, CERTIFICATE_FILE, CA_FILE)
"""Of whoever holds a certificate."""
SLACK = timedelta(minutes=5)  # by which clocks may differ


def init(folder: Path, valid: timedelta) -> Path:
    """Make an authority in a folder.

    Returns:
        Its certificate.

    Raises:
        UsageError: there is one, or the folder cannot be written.
    """
    check_installed()
    if (folder / REGISTER_FILE).exists():
        raise UsageError(f"{folder}: holds an authority already. Name another folder")
    if (folder / CA_KEY_FILE).exists():
        raise UsageError(
            f"{folder}: holds {CA_KEY_FILE} and no {REGISTER_FILE}. Where an `init` was cut short, "
            f"remove {CA_KEY_FILE}; where the register was lost, name another folder"
        )
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    subject = _name("hoap3 authority", "authority")
    usage = x509.KeyUsage(
        digital_signature=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=True,
        crl_sign=True,
        encipher_only=False,
        decipher_only=False,
    )
    public = key.public_key()
    certificate = (
        _builder(subject, subject, public, valid)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)
        .sign(key, hashes.SHA256())
    )
    with _writing(folder):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with whole_file(folder / CA_KEY_FILE) as draft:
            _write_secret(draft, _pem_of_key(key))
        _write(folder / CA_FILE, _pem(certificate))
        _write(folder / REGISTER_FILE, Register().to_yaml().encode())
    return folder / CA_FILE


def issue(
    folder: Path, name: str, role: Role, hosts: Sequence[str], valid: timedelta
) -> tuple[Path, list[Path], list[str]]:
    """Make a certificate.

    Args:
        folder: of the authority.
        name: of whoever holds it; of a robot, its name on the network.
        role: what it may do.
        hosts: names and addresses at which a robot is reached, besides those of its own machine.
        valid: for how long.

    Returns:
        Its directory, the lists of robots that were changed, and for each that cannot be, why.

    Raises:
        UsageError: the name is taken, or no robot and yet hosts.
        ConfigError: that can be no name, or no host.
    """
    register = read_register(folder)
    if register.find(name) is not None:
        raise UsageError(
            f"{name!r} has a certificate already: `hoap3 certs renew {name}`, or choose another "
            "name. A revoked one is never used again"
        )
    entry = parse(Entry, {"name": name, "role": role, "expires": ""}, "hoap3 certs issue")
    _check_hosts(hosts, entry)
    entry = _make(folder, entry, [*HOSTS, *hosts] if role == "robot" else [], valid)
    if role == "robot":
        own = folder / name / ACCESS_FILE
        with _writing(own.parent):
            _write(own, _everybody(register).to_yaml().encode())
        _save(folder, register.with_entry(entry))
        return own.parent, [own], []
    _save(folder, register.with_entry(entry))  # before anybody lets it in: so it can be revoked
    changed, failed = _change_lists(  # the name may stand there by hand
        folder, register, lambda access: access.without(name).with_name(name, role)
    )
    return folder / name, changed, failed


def renew(folder: Path, name: str, valid: timedelta, hosts: Sequence[str] = ()) -> Path:
    """Make a new key and certificate for the same name and role; its directory.

    Args:
        folder: of the authority.
        name: of whoever holds it.
        valid: for how long.
        hosts: at which a robot is reached instead, besides those of its own machine; none: those
            of before.

    Raises:
        UsageError: there is no such certificate, it was revoked, or no robot and yet hosts.
        ConfigError: a host that can be none.
    """
    register = read_register(folder)
    entry = register.get(name)
    _check_hosts(hosts, entry)
    if entry.role == "robot":
        hosts = [*HOSTS, *hosts] if hosts else _hosts_in(folder / name / CERTIFICATE_FILE)
    _save(folder, register.with_entry(_make(folder, entry, hosts, valid)))
    return folder / name


def revoke(folder: Path, name: str) -> tuple[list[Path], list[str]]:
    """Take a name from the lists of all robots, for ever.

    Returns:
        The lists that were changed, and for each that cannot be, why: it was moved, for example.

    Raises:
        UsageError: there is no such certificate, or it was revoked, or it is a robot's.
    """
    register = read_register(folder)
    entry = register.get(name)
    if entry.role == "robot":
        raise UsageError(
            f"{name!r} is a robot, which is on no list: where its key was stolen, begin with a new "
            "authority"
        )
    changed, failed = _change_lists(folder, register, lambda access: access.without(name))
    _save(folder, register.with_entry(entry.model_copy(update={"revoked": True})))
    return changed, failed


def _make(folder: Path, entry: Entry, hosts: Sequence[str], valid: timedelta) -> Entry:
    """Write the directory of a certificate; the entry with its end."""
    check_installed()
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.hazmat.primitives.serialization import load_pem_private_key
    from cryptography.x509.oid import ExtendedKeyUsageOID

    with _reading(folder / CA_KEY_FILE, "The authority's key, without a password, belongs there"):
        ca_key: Any = load_pem_private_key((folder / CA_KEY_FILE).read_bytes(), None)
    with _reading(folder / CA_FILE, "The authority's certificate belongs there"):
        ca_pem = (folder / CA_FILE).read_bytes()
        ca = x509.load_pem_x509_certificate(ca_pem)
    key = ec.generate_private_key(ec.SECP256R1())
    robot = entry.role == "robot"
    purpose = ExtendedKeyUsageOID.SERVER_AUTH if robot else ExtendedKeyUsageOID.CLIENT_AUTH
    issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(ca_key.public_key())
    builder = (
        _builder(_name(entry.name, entry.role), ca.subject, key.public_key(), valid)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=True)
        .add_extension(issuer, critical=False)
        .add_extension(_alternatives(hosts or [entry.name]), critical=False)
    )
    certificate = builder.sign(ca_key, hashes.SHA256())
    place = folder / entry.name
    with _writing(place), ExitStack() as at_once:  # a key without its certificate is worth nothing
        place.mkdir(mode=0o700, exist_ok=True)
        drafts = [at_once.enter_context(whole_file(place / name)) for name in FILES]
        _write_secret(drafts[0], _pem_of_key(key))
        drafts[1].write_bytes(_pem(certificate))
        drafts[2].write_bytes(ca_pem)
    return entry.model_copy(update={"expires": certificate.not_valid_after_utc.isoformat()})


def _everybody(register: Register) -> Access:
    """The list of a new robot: all names that are in use."""
    access = Access()
    for each in register.certificates:
        if each.role != "robot" and not each.revoked:
            access = access.with_name(each.name, each.role)
    return access


def _change_lists(
    folder: Path, register: Register, change: Callable[[Access], Access]
) -> tuple[list[Path], list[str]]:
    """Change the lists of all robots; which were, and for each that cannot be, why."""
    changed: list[Path] = []
    failed: list[str] = []
    for robot in register.certificates:
        if robot.role != "robot":
            continue
        file = folder / robot.name / ACCESS_FILE
        try:
            before = read_access(file.parent)
            after = change(before)
            if after != before:
                _write(file, after.to_yaml().encode())
                changed.append(file)
        except (ConfigError, OSError) as error:
            failed.append(str(error) if isinstance(error, ConfigError) else f"{file}: {error}")
    return changed, failed


def _check_hosts(hosts: Sequence[str], entry: Entry) -> None:
    """Only a robot is reached at hosts."""
    if hosts and entry.role != "robot":
        raise UsageError(f"--host is for a robot, and {entry.name!r} is {entry.role}")


def _save(folder: Path, register: Register) -> None:
    with _writing(folder):
        _write(folder / REGISTER_FILE, register.to_yaml().encode())


def _builder(subject: Any, issuer: Any, public: Any, valid: timedelta) -> Any:
    from cryptography import x509

    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(public)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - SLACK)
        .not_valid_after(now + valid)
    )


def _name(common: str, unit: str) -> Any:
    from cryptography import x509
    from cryptography.x509.oid import NameOID

    parts = (NameOID.ORGANIZATIONAL_UNIT_NAME, unit), (NameOID.COMMON_NAME, common)
    return x509.Name([x509.NameAttribute(oid, text) for oid, text in parts])


def _alternatives(hosts: Iterable[str]) -> Any:
    """Subject alternative names.

    Raises:
        ConfigError: one is neither a name nor an address.
    """
    from cryptography import x509

    names: list[x509.GeneralName] = []
    for host in hosts:
        try:
            names.append(x509.IPAddress(ipaddress.ip_address(host)))
        except ValueError:
            if not host or not host.isascii() or any(letter in host for letter in "/:* "):
                problem = "is neither a host name nor an address"
                raise ConfigError("--host", "", host, problem, "Write 192.168.1.10") from None
            names.append(x509.DNSName(host))
    return x509.SubjectAlternativeName(names)


def _hosts_in(certificate: Path) -> list[str]:
    from cryptography import x509

    with _reading(certificate, "Name the hosts at which the robot is reached: --host"):
        content = x509.load_pem_x509_certificate(certificate.read_bytes())
    names = content.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return [str(each.value) for each in names]


def _pem(certificate: Any) -> bytes:
    from cryptography.hazmat.primitives.serialization import Encoding

    return bytes(certificate.public_bytes(Encoding.PEM))


def _pem_of_key(key: Any) -> bytes:
    from cryptography.hazmat.primitives import serialization as form

    return bytes(
        key.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, form.NoEncryption())
    )


@contextmanager
def _reading(file: Path, remedy: str) -> Iterator[None]:
    """Name the file that cannot be read, or is not what it should be."""
    try:
        yield
    except (OSError, TypeError, ValueError) as error:
        why = (isinstance(error, OSError) and error.strerror) or str(error)
        raise UsageError(f"{file}: cannot be read ({why}). {remedy}") from error


@contextmanager
def _writing(place: Path) -> Iterator[None]:
    """Name the place that cannot be written."""
    try:
        yield
    except OSError as error:
        raise UsageError(
            f"{place}: cannot be written ({error.strerror}). Name a folder of your own"
        ) from error


def _write(path: Path, data: bytes) -> None:
    with whole_file(path) as draft:
        draft.write_bytes(data)


def _write_secret(draft: Path, data: bytes) -> None:
    """Write a new file that its owner alone may read, from the first moment on."""
    new = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(new, "wb") as file:
        file.write(data)
