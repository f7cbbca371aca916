"""Counters of all links, as rows for a table or for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rich import box
from rich.table import Table

from gcs.io.links.vehicle_links import VehicleLinks
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.link_stats import LinkCounters
from gcs.mavlink.frames.signing import SigningCounters
from gcs.mavlink.router.router import PortCounters

_STATIONS = "other_ground_stations"
_COLUMNS = (
    "link", "role", "frames", "lost", "CRC", "unknown_systems", "conflicts", "unsent", "radio", "signing",
    _STATIONS,
)  # fmt: skip
_ALWAYS = ("link", "role", "frames", "lost")


def link_rows(fleet: Fleet, links: VehicleLinks | None, t_ns: int) -> list[dict[str, Any]]:
    """Return a row for each link: those of vehicles, then the endpoints of other ground stations.

    Parameters
    ----------
    links : VehicleLinks or None
        None in a replay, which has no other ground stations.
    """
    unsent = {} if links is None else links.unsent()
    silent = [] if links is None else [link.name for link in links.links if link.role == "vehicles"]
    heard = {name: LinkCounters() for name in silent} | fleet.links
    rows: list[dict[str, Any]] = [
        {
            "link": name,
            "role": "vehicles",
            **asdict(counters),
            "unsent": unsent.get(name, 0),
            "radio": None if (radio := fleet.radios.get(name)) is None else asdict(radio),
            **_signing(links, name),
        }
        for name, counters in heard.items()
    ]
    if links is None:
        return rows
    stations = links.ground_stations(t_ns)
    counters = links.counters()
    for link in links.links:
        if link.role == "vehicles":
            continue
        counted = counters.get(link.name, PortCounters())
        row = {"link": link.name, "role": link.role, _STATIONS: stations[link.name], **asdict(counted)}
        row |= {"refused": dict(counted.refused), "unsent": unsent[link.name]}
        rows.append({**row, **_signing(links, link.name)})
    return rows


def _signing(links: VehicleLinks | None, name: str) -> dict[str, Any]:
    """Return the counters of a link's signing gate; empty without keys and without signed frames."""
    if links is None or not (links.is_keyed(name) or name in links.signing_counters()):
        return {}
    counters = links.signing_counters().get(name, SigningCounters())
    return {"verified": counters.verified, "signed": counters.signed, "rejected": dict(counters.rejected)}


def link_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return a table of the rows, without columns that are empty for all links."""
    table = Table(title="Links", title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    cells = [_cells(row) for row in rows]
    shown = [name for name in _COLUMNS if name in _ALWAYS or any(row[name] not in ("", 0) for row in cells)]
    for name in shown:
        left = name in ("link", "role", "radio", "signing", _STATIONS)
        title = name.replace("_", " ")
        table.add_column(title, justify="left" if left else "right", no_wrap=name in _ALWAYS, overflow="fold")
    for row in cells:
        table.add_row(*(str(row[name]) for name in shown))
    return table


def _cells(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the text of a row for each column."""
    cells = {**dict.fromkeys(_COLUMNS, ""), **row, "radio": _radio(row), "signing": _gate(row), _STATIONS: ""}
    if row["role"] == "vehicles":
        return cells | {"lost": _loss(row), "CRC": row["crc_errors"]}
    refused = sum(row["refused"].values())
    counted = f"{row['sent']} sent, {row['passed']} passed on, {refused} refused"
    return cells | {_STATIONS: f"{len(row[_STATIONS])}; {counted}"}


def _gate(row: Mapping[str, Any]) -> str:
    """Return the counts of verified and rejected frames as text; empty without signing."""
    if "rejected" not in row:
        return ""
    return f"{row['verified']} verified, {sum(row['rejected'].values())} rejected"


def _radio(row: Mapping[str, Any]) -> str:
    """Return the report of a link's radio as text; empty without one."""
    if (one := row.get("radio")) is None:
        return ""
    here = f"signal {one['signal']} (noise {one['noise']})"
    there = f"{one['remote_signal']} ({one['remote_noise']}) there"
    return f"{here}, {there}; buffer {one['free_percent']} % free"


def _loss(row: Mapping[str, Any]) -> str:
    sent = row["frames"] - row["unknown_systems"] - row["conflicts"] + row["lost"]
    return f"{100.0 * row['lost'] / sent:.1f} %" if sent > 0 else "0.0 %"
