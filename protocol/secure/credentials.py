"""A directory of the secure profile: a certificate, its key, and the CA that both sides trust.

`hoap3 certs` writes it. The common name of the certificate is who we are, its organisational unit
the role; a robot's certificate serves TLS and no other does, so that no client can pose as a robot.
"""

from __future__ import annotations

import stat
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hoap3.protocol.errors import ConfigError, NotInstalledError
from hoap3.protocol.secure.roles import ROLES, Role

CA_FILE, CERTIFICATE_FILE, KEY_FILE = "ca.pem", "cert.pem", "key.pem"


@dataclass(frozen=True)
class Credentials:
    """What a process shows to others.

    Attributes:
        directory: where the files lie.
        name: common name of the certificate.
        role: that its holder has.
        expires: when it ends.
    """

    directory: Path
    name: str
    role: Role
    expires: datetime

    @property
    def ca(self) -> Path:
        """Certificate of the authority that both sides trust."""
        return self.directory / CA_FILE

    @property
    def certificate(self) -> Path:
        """Our certificate."""
        return self.directory / CERTIFICATE_FILE

    @property
    def key(self) -> Path:
        """Its private key."""
        return self.directory / KEY_FILE

    def session_name(self, rest: str) -> str:
        """Name of one of our sessions, as our keys end: `<name>.<rest>`."""
        return f"{self.name}.{rest}"

    def tls(self) -> dict[str, Any]:
        """Zenoh's `transport/link/tls`: both sides show certificates, which must not be expired."""
        key, certificate = str(self.key), str(self.certificate)
        return {
            "root_ca_certificate": str(self.ca),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
            "listen_private_key": key,
            "listen_certificate": certificate,
            "connect_private_key": key,
            "connect_certificate": certificate,
        }


def check_installed() -> None:
    """Refuse what needs certificates, where they cannot be read.

    Raises:
        NotInstalledError: cryptography is not installed.
    """
    try:
        import cryptography  # noqa: F401
    except ImportError as error:
        raise NotInstalledError("package", "cryptography", "'hoap3[secure]'") from error


def read_credentials(directory: str | Path) -> Credentials:
    """The credentials in a directory, checked.

    Raises:
        ConfigError: a file is missing or wrong, the key can be read by others or is another
            certificate's, the certificate is another authority's, expired, or no role's.
        NotInstalledError: cryptography is not installed.
    """
    check_installed()
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    folder = Path(directory).absolute()
    ca_file, file, key_file = (folder / name for name in (CA_FILE, CERTIFICATE_FILE, KEY_FILE))
    ca = _parsed(ca_file, x509.load_pem_x509_certificate)
    certificate = _parsed(file, x509.load_pem_x509_certificate)
    key = _parsed(key_file, lambda data: load_pem_private_key(data, None))
    if stat.S_IMODE(key_file.stat().st_mode) & 0o077:
        raise ConfigError(
            str(key_file), "", None, "can be read by others", f"Run `chmod 600 {key_file}`"
        )
    if key.public_key() != certificate.public_key():
        problem = f"is not the key of {CERTIFICATE_FILE}"
        raise ConfigError(str(key_file), "", None, problem, "Copy both from one directory")
    try:
        certificate.verify_directly_issued_by(ca)
    except (InvalidSignature, TypeError, ValueError) as error:
        problem = f"was not issued by the authority in {CA_FILE}"
        raise ConfigError(str(file), "", None, problem, "Copy both from one directory") from error
    name, role = subject_of(certificate, str(file))
    now, expires = datetime.now(UTC), certificate.not_valid_after_utc
    if now >= expires:
        problem = f"expired on {expires:%Y-%m-%d %H:%M} UTC"
        raise ConfigError(str(file), "", None, problem, f"Run `hoap3 certs renew {name}`")
    if now < certificate.not_valid_before_utc:
        begins = f"is valid only from {certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC on"
        raise ConfigError(str(file), "", None, begins, "Correct this machine's clock")
    return Credentials(folder, name, role, expires)


def subject_of(certificate: Any, file: str) -> tuple[str, Role]:
    """Name and role in a certificate.

    Raises:
        ConfigError: it has none that we know.
    """
    from cryptography.x509.oid import NameOID

    names, units = (
        [str(each.value) for each in certificate.subject.get_attributes_for_oid(oid)]
        for oid in (NameOID.COMMON_NAME, NameOID.ORGANIZATIONAL_UNIT_NAME)
    )
    role = next((role for role in ROLES if units == [role]), None)
    if len(names) != 1 or role is None:
        remedy = "Have `hoap3 certs issue` make one"
        raise ConfigError(file, "", None, "has no name and role of ours", remedy)
    return names[0], role


def _parsed(path: Path, parse: Any) -> Any:
    """What a PEM file holds; its content is in no error."""
    try:
        return parse(path.read_bytes())
    except OSError as error:
        problem = f"cannot be read: {error.strerror}"
        remedy = "Name a directory that `hoap3 certs issue` made"
        raise ConfigError(str(path), "", None, problem, remedy) from error
    except (TypeError, ValueError):
        remedy = "Name a directory that `hoap3 certs issue` made"
        raise ConfigError(str(path), "", None, "is not what it should be, in PEM", remedy) from None
