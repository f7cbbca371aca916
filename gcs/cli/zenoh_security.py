"""What `gcs run` and `gcs check` say about the protection of zenoh."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from gcs.endpoints import is_loopback

if TYPE_CHECKING:
    from gcs.config.schema import LinksTable
    from gcs.io.zenoh.certificates import Node

_EXPIRY_WARNING_DAYS: Final = 30


def zenoh_warnings(links: LinksTable, node: Node | None) -> list[str]:
    """Return warnings about an unprotected endpoint, or a certificate that expires soon."""
    if node is not None:
        left = node.expires - datetime.now(tz=UTC)
        if left.days >= _EXPIRY_WARNING_DAYS:
            return []
        when = f"{node.expires:%Y-%m-%d %H:%M} UTC"
        text = f"the certificate {node.common_name} expires on {when}; nodes cannot connect after that"
        return [f"warning: {text} (gcs keys node)"]
    if is_loopback(links.zenoh):
        return []
    text = f"every program that reaches {links.zenoh} may command the vehicles (docs/security.md)"
    return [f"warning: zenoh_unprotected: {text}"]
