"""Handshake with a zenoh endpoint, to say why a TLS connection fails: zenoh does not.

The handshake is made once more with Python's `ssl`. In TLS 1.3 the other side's refusal of our certificate
comes after the handshake, as an alert.
"""

from __future__ import annotations

import socket
import ssl
from pathlib import Path
from typing import Final

_TIMEOUT_S: Final = 2.0
_ALERT_S: Final = 1.0
"""Wait for a refusal after the handshake."""
_ALERTS: Final = {
    "UNKNOWN_CA": "this node's certificate is of another CA than that one's",
    "CERTIFICATE_EXPIRED": "this node's certificate has expired",
    "CERTIFICATE_REQUIRED": "no certificate was sent",
    "DECRYPT_ERROR": "this node's certificate is of another CA of the same name",
}
"""Reasons of OpenSSL, by the words of the alert in them."""


def tls_problem(endpoint: str, folder: Path) -> str:
    """Return why the TLS handshake with a zenoh endpoint is refused; empty if it is not, or nothing listens.

    Parameters
    ----------
    endpoint : str
        Such as ``tls/10.0.0.5:7447``.
    folder : Path
        Folder of this node's certificate.
    """
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(folder / "ca.pem")
    context.load_cert_chain(folder / "node.pem", folder / "node.key")
    try:
        with (
            socket.create_connection((host, int(port)), _TIMEOUT_S) as plain,
            context.wrap_socket(plain, server_hostname=host) as secure,
        ):
            secure.settimeout(_ALERT_S)
            secure.recv(1)
    except ssl.SSLCertVerificationError as error:
        return f"the certificate there is not valid: {error.verify_message}"
    except ssl.SSLError as error:
        reason = error.reason or str(error)
        told = next((text for word, text in _ALERTS.items() if word in reason), None)
        return f"the connection is refused: {told or reason.replace('_', ' ').lower()}"
    except OSError:  # nothing listens
        return ""
    return ""
