"""Access of a command to the vehicles: by the mission file's links, or through the running service.

While `gcs run` serves a mission it owns the links. A command is then a second ground station at a forward
endpoint of the service, with its own system id: answers come to it alone, and vehicles keep the service's
heartbeats.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gcs.config import Config
from gcs.endpoints import Endpoint, Link, parse_endpoint
from gcs.errors import LinkError
from gcs.io.zenoh.discovery import ServiceInfo, running_services
from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, OWN_IDS

_SECOND_GCS_SYSTEM_ID: Final = 254
_CALLERS: Final = {"udpin": "udpout", "tcpin": "tcp"}
_ANY_HOST: Final = ("", "0.0.0.0")  # noqa: S104  read, not listened on


@dataclass(frozen=True, slots=True)
class VehicleAccess:
    """Links to the vehicles, and our ids there."""

    links: tuple[Link, ...]
    own: tuple[int, int] = OWN_IDS
    service: ServiceInfo | None = None
    """Running service that owns the mission's links, if any. Vehicles watch its heartbeats."""

    @property
    def description(self) -> str:
        """Text about a service in between; empty without one."""
        if self.service is None:
            return ""
        return f"through gcs run (process {self.service.pid}) at {', '.join(one.name for one in self.links)}"


def vehicle_access(config: Config, link: str | None, *, writes: bool) -> VehicleAccess:
    """Return the access to a mission's vehicles.

    Parameters
    ----------
    link : str or None
        Endpoint that an operator chose instead.
    writes : bool
        True if something on the vehicles is to be changed.

    Raises
    ------
    LinkError
        The service has no suitable endpoint, or `link` is not an endpoint.
    """
    service = next((one for one in running_services() if one.mission == config.name), None)
    own = (GCS_SYSTEM_ID if service is None else _SECOND_GCS_SYSTEM_ID, GCS_COMPONENT_ID)
    if link is not None:
        return VehicleAccess((Link(parse_endpoint(link)),), own, service)
    if service is None:
        vehicles = tuple(one for one in config.mavlink_links if one.role == "vehicles")
        return VehicleAccess(vehicles, own)
    roles = ("full",) if writes else ("full", "read-only")
    endpoints: dict[int, Link] = {}
    for role in roles:
        for one in config.mavlink_links:
            if one.role == role and one.endpoint.listens and one.endpoint.port:
                endpoints.setdefault(one.network, one)
    for network in sorted({agent.network for agent in config.agents}):
        if network not in endpoints:
            raise LinkError("gcs run", _missing(service, network, writes))
    return VehicleAccess(
        tuple(Link(_caller(d.endpoint), d.network) for d in endpoints.values()), own, service
    )


def _missing(service: ServiceInfo, network: int, writes: bool) -> str:
    where = f" of network {network}" if network else ""
    access = ' and access = "full"' if writes else ""
    return (
        f"has the links of {service.mission} (process {service.pid}), and no forward endpoint{where} that "
        f"listens{access}: add one to [[links.forward]] and start it again, or end it first"
    )


def _caller(endpoint: Endpoint) -> Endpoint:
    host = "127.0.0.1" if endpoint.host in _ANY_HOST else endpoint.host
    return parse_endpoint(f"{_CALLERS[endpoint.kind]}:{host}:{endpoint.port}")
