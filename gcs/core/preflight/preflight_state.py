"""State of preflight checks that go on in flight."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class AgentReturn:
    """Return height of one vehicle."""

    parameters: dict[str, float] = field(default_factory=dict)
    """Parameters heard that set it, by name."""
    requests: int = 0
    """Requests for them."""
    next_request_t_ns: int = 0
    is_told: bool = False
    """True if it was told that the vehicle would return at the height of another."""
