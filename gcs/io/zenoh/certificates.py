"""A node's certificate: a folder with `ca.pem`, `node.pem` and `node.key`, as `gcs keys node` makes it.

The common name says role and name (`gcs.io.zenoh.access_control`). The folder of a command node also has
`nodes.toml`: the names of the nodes that may connect, and their roles. A line that is removed there takes a
certificate's rights away.
"""

from __future__ import annotations

import re
import stat
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import msgspec
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import NameOID

from gcs.config import Table, convert, decode_toml
from gcs.config.schema import NODE_NAME
from gcs.errors import ConfigError
from gcs.files import read_bytes, read_text
from gcs.io.zenoh.access_control import ROLES, Role, common_name
from gcs.mistake_codes import MistakeCode

CA: Final = "ca.pem"
CERTIFICATE: Final = "node.pem"
KEY: Final = "node.key"
NODES: Final = "nodes.toml"
_MAX_BYTES: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class Node:
    """A node with its certificate."""

    folder: Path
    role: Role
    name: str
    expires: datetime
    """End of the certificate's validity."""

    @property
    def common_name(self) -> str:
        """Common name of the certificate."""
        return common_name(self.role, self.name)

    def access(self, *, listens: bool) -> dict[str, Role] | None:
        """Return the nodes that may connect to this one; None if it is no command, nor a bridge that listens.

        Raises
        ------
        ConfigError
            When `nodes.toml` is missing or wrong.
        """
        if not (self.role == "command" or (self.role == "bridge" and listens)):
            return None
        return read_nodes(self.folder / NODES) | {self.name: self.role}


class _NodesTable(Table, frozen=True, kw_only=True):
    nodes: dict[str, Role] = msgspec.field(default_factory=dict)


def read_nodes(path: Path) -> dict[str, Role]:
    """Return the roles of the nodes in a `nodes.toml`, by name.

    Raises
    ------
    ConfigError
        When it is missing, writable by others, not TOML, or names something else.
    """
    source = str(path)
    try:
        if path.stat().st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise ConfigError(
                source, "", MistakeCode.INSECURE, f"others may change this list: chmod go-w {path}"
            )
        raw = decode_toml(read_text(path, _MAX_BYTES), source)
    except FileNotFoundError:
        problem = "is missing; it says who may connect: `gcs keys node` writes it beside ca.key, copy it here"
        raise ConfigError(source, "", MistakeCode.NOT_FOUND, problem) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(source, "", MistakeCode.NO_ACCESS, f"cannot be read: {_reason(error)}") from None
    nodes = convert(raw, _NodesTable, source).nodes
    for name in nodes:
        if not re.match(NODE_NAME, name):
            problem = "expected a name of 1 to 48 letters, digits, - and _"
            raise ConfigError(source, f"nodes.{name}", MistakeCode.WRONG_TYPE, problem)
    return nodes


def read_node(folder: Path) -> Node:
    """Read and check the certificate of a node.

    Raises
    ------
    ConfigError
        When a file is missing, readable by others (the key), unreadable or of another kind, or when the
        certificate has expired or does not name a role. The text has no key.
    """
    for name in (CA, CERTIFICATE, KEY):
        if not (folder / name).exists():
            problem = f"is missing; `gcs keys node` makes a folder with {CA}, {CERTIFICATE} and {KEY}"
            raise ConfigError(str(folder / name), "", MistakeCode.NOT_FOUND, problem)
    mode = (folder / KEY).stat().st_mode
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        problem = f"others may read this key (mode {stat.S_IMODE(mode):o}): chmod 600 {folder / KEY}"
        raise ConfigError(str(folder / KEY), "", MistakeCode.INSECURE, problem)
    _load(folder / CA)
    certificate = _load(folder / CERTIFICATE)
    _check_key(folder, certificate)
    role, name = _role_and_name(folder, certificate)
    now = datetime.now(tz=UTC)
    expires = certificate.not_valid_after_utc
    if now > expires:
        problem = (
            f"expired on {expires:%Y-%m-%d %H:%M} UTC: remove its folder and make a new one with "
            "`gcs keys node`; or is the clock of this machine wrong?"
        )
        raise ConfigError(str(folder / CERTIFICATE), "", MistakeCode.BAD_CREDENTIALS, problem)
    if now < certificate.not_valid_before_utc:
        start = certificate.not_valid_before_utc
        problem = f"is valid from {start:%Y-%m-%d %H:%M} UTC on; is the clock of this machine right?"
        raise ConfigError(str(folder / CERTIFICATE), "", MistakeCode.BAD_CREDENTIALS, problem)
    return Node(folder, role, name, expires)


def _load(path: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(read_bytes(path, _MAX_BYTES))
    except (OSError, ValueError) as error:
        raise ConfigError(
            str(path),
            "",
            MistakeCode.BAD_CREDENTIALS,
            f"expected a certificate in PEM form: {_reason(error)}",
        ) from None


def _check_key(folder: Path, certificate: x509.Certificate) -> None:
    path = folder / KEY
    try:
        key = load_pem_private_key(read_bytes(path, _MAX_BYTES), None)
    except OSError as error:
        raise ConfigError(str(path), "", MistakeCode.NO_ACCESS, f"cannot be read: {_reason(error)}") from None
    except (ValueError, TypeError):  # Their texts are not shown: this is the key.
        raise ConfigError(
            str(path),
            "",
            MistakeCode.BAD_CREDENTIALS,
            "expected a private key in PEM form, without a passphrase",
        ) from None
    if key.public_key() != certificate.public_key():
        raise ConfigError(str(path), "", MistakeCode.BAD_CREDENTIALS, f"is not the key of {CERTIFICATE}")


def _role_and_name(folder: Path, certificate: x509.Certificate) -> tuple[Role, str]:
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    text = str(names[0].value) if names else ""
    role, _, name = text.partition(".")
    known = next((one for one in ROLES if one == role), None)
    if known is None or not re.match(NODE_NAME, name):
        problem = f"expected a common name such as sensor.radar-1 ({', '.join(ROLES)}), got {text!r}"
        raise ConfigError(str(folder / CERTIFICATE), "", MistakeCode.BAD_CREDENTIALS, problem)
    return known, name


def _reason(error: Exception) -> str:
    return (isinstance(error, OSError) and error.strerror) or str(error)
