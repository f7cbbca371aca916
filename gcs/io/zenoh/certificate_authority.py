"""Making a certificate authority and the certificates of nodes (X.509 v3, RFC 5280; EC P-256).

The CA is a folder with `ca.pem` (public), `ca.key` (secret) and `nodes.toml`. Each node has a folder
there, named as its certificate. Nodes that accept connections get names of their hosts and may be TLS
servers; others may be TLS clients only, so that none can pose as central command with its certificate.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from gcs.config.schema import NODE_NAME
from gcs.errors import ConfigError
from gcs.files import read_bytes
from gcs.io.private_files import make_private
from gcs.io.signing.keystore import write_secret
from gcs.io.zenoh.access_control import Role, common_name
from gcs.io.zenoh.certificates import CA, CERTIFICATE, KEY, NODES, read_nodes
from gcs.mistake_codes import MistakeCode

CA_KEY: Final = "ca.key"
_CLOCK_TOLERANCE: Final = timedelta(hours=1)
"""Certificates are valid from before now: clocks in the field differ."""
_THIS_MACHINE: Final = ("localhost", "127.0.0.1", "::1")
_MAX_BYTES: Final = 1_000_000
_NODES_HEAD: Final = (
    "# Nodes that may take part, and their roles; the service reads this once, when it starts.\n"
    "# A line that is removed takes a certificate's rights away.\n[nodes]\n"
)


def make_certificate_authority(folder: Path, days: int) -> None:
    """Make a certificate authority in a folder for its owner alone.

    Raises
    ------
    ConfigError
        When there is one, or it cannot be written.
    """
    _refuse_existing(folder, (CA, CA_KEY))
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "swarm-gcs authority")])
    usage = _usage(key_cert_sign=True, crl_sign=True)
    certificate = (
        _builder(name, name, key.public_key(), days)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .sign(key, hashes.SHA256())
    )
    _write(folder, {CA: certificate.public_bytes(Encoding.PEM), CA_KEY: _pem(key)})


def make_node(ca: Path, name: str, role: Role, hosts: Sequence[str], days: int) -> Path:
    """Make a node's certificate; return its folder. Adds the node to `nodes.toml`, and to its copies.

    Parameters
    ----------
    hosts : sequence of str
        Host names and addresses at which it accepts connections.

    Raises
    ------
    ConfigError
        When the CA cannot be read, or the node exists already.
    """
    if not re.match(NODE_NAME, name):
        raise ConfigError("NAME", name, MistakeCode.WRONG_TYPE, "expected 1 to 48 letters, digits, - and _")
    issuer, issuer_key = _read_ca(ca)
    path = ca / NODES
    nodes = read_nodes(path) if path.exists() else {}
    if nodes.get(name, role) != role:
        problem = f"is listed with the role {nodes[name]}; choose another name"
        raise ConfigError(str(path), f"nodes.{name}", MistakeCode.DUPLICATE, problem)
    folder = ca / common_name(role, name)
    _refuse_existing(folder, (CERTIFICATE, KEY))
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name(role, name))])
    accepts = role == "command" or bool(hosts)
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH, *([ExtendedKeyUsageOID.SERVER_AUTH] if accepts else [])]
    builder = (
        _builder(subject, issuer.subject, key.public_key(), days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(digital_signature=True), critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key()), critical=False
        )
    )
    if accepts:
        names = dict.fromkeys((*_THIS_MACHINE, *hosts))
        builder = builder.add_extension(x509.SubjectAlternativeName(map(_host, names)), critical=False)
    certificate = builder.sign(issuer_key, hashes.SHA256())
    public = {CA: issuer.public_bytes(Encoding.PEM), CERTIFICATE: certificate.public_bytes(Encoding.PEM)}
    _write(folder, public | {KEY: _pem(key)})
    _save_nodes(ca, nodes | {name: role})
    return folder


def _save_nodes(ca: Path, nodes: dict[str, Role]) -> None:
    """Write `nodes.toml` of the CA and of the command nodes and bridges beside it."""
    text = _NODES_HEAD + "".join(f'{name} = "{role}"\n' for name, role in sorted(nodes.items()))
    readers = [ca / common_name(role, name) for name, role in nodes.items() if role in ("command", "bridge")]
    for folder in (ca, *(one for one in readers if one.is_dir())):
        _write(folder, {NODES: text.encode()})


def _read_ca(folder: Path) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    try:
        certificate = x509.load_pem_x509_certificate(read_bytes(folder / CA, _MAX_BYTES))
        key = load_pem_private_key(read_bytes(folder / CA_KEY, _MAX_BYTES), None)
    except FileNotFoundError as error:
        problem = f"is missing: `gcs keys ca {folder}` makes a CA"
        raise ConfigError(str(error.filename), "", MistakeCode.NOT_FOUND, problem) from None
    except (OSError, ValueError, TypeError):
        problem = f"expected {CA} and {CA_KEY} of a CA, as `gcs keys ca` makes them"
        raise ConfigError(str(folder), "", MistakeCode.BAD_CREDENTIALS, problem) from None
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
        raise ConfigError(str(folder / CA_KEY), "", MistakeCode.BAD_CREDENTIALS, f"is not the key of {CA}")
    return certificate, key


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.now(tz=UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _CLOCK_TOLERANCE)
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _usage(
    *, digital_signature: bool = False, key_cert_sign: bool = False, crl_sign: bool = False
) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=digital_signature,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=key_cert_sign,
        crl_sign=crl_sign,
        encipher_only=False,
        decipher_only=False,
    )


def _host(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        pass
    try:
        return x509.DNSName(name)
    except ValueError:
        raise ConfigError(
            "--host", name, MistakeCode.WRONG_TYPE, "expected a host name in ASCII, or an address"
        ) from None


def _pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


def _refuse_existing(folder: Path, names: Sequence[str]) -> None:
    for name in names:
        if (folder / name).exists():
            problem = "exists and is kept; remove its folder first, or choose another"
            raise ConfigError(str(folder / name), "", MistakeCode.EXISTS, problem)


def _write(folder: Path, files: dict[str, bytes]) -> None:
    try:
        make_private(folder, exist_ok=True)
        for name, data in files.items():
            write_secret(folder / name, data)
    except OSError as error:
        raise ConfigError(
            str(folder), "", MistakeCode.NO_ACCESS, f"cannot be written: {error.strerror}"
        ) from None
