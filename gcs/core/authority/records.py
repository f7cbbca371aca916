"""State of control authority: overrides, missions of other ground stations, audits."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class AgentAuthority:
    """Control authority over one vehicle, besides its `gcs.model.Control`."""


@dataclass(slots=True)
class AuthorityState:
    """What belongs to no single vehicle."""
