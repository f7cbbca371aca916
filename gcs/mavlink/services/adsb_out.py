"""ADS-B out: target tracks as ADSB_VEHICLE, so that any ground station shows them on its map.

https://mavlink.io/en/messages/common.html#ADSB_VEHICLE. A track's ICAO address is made from its label in the
unassigned block F00000 ... FFFFFF: stable over the track's life, and of no real aircraft. The height is that
of the mission's origin and not marked as valid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.geo import LocalFrame
from gcs.mavlink.frames.codec import Message
from gcs.model import NS_PER_S, Label, Picture, Track, target_name

COMPONENT_ID: Final[int] = dialect.MAV_COMP_ID_ADSB
_FLAGS: Final[int] = (
    dialect.ADSB_FLAGS_VALID_COORDS
    | dialect.ADSB_FLAGS_VALID_HEADING
    | dialect.ADSB_FLAGS_VALID_VELOCITY
    | dialect.ADSB_FLAGS_VALID_CALLSIGN
)
UNASSIGNED_ICAO_BLOCK: Final = 0xF00000
_INDEX_BITS: Final = 6
_MAX_CALLSIGN_LENGTH: Final = 8
_MAX_CM_S: Final = 65_535


def icao_address(label: Label) -> int:
    """Return the 24-bit address of a track: unique for 64 births a scan over 16384 scans."""
    scan, index = label
    number = (scan << _INDEX_BITS) | (index & ((1 << _INDEX_BITS) - 1))
    return UNASSIGNED_ICAO_BLOCK | (number & 0x0FFFFF)


def callsign(label: Label) -> str:
    """Return the name on the map: the label, or the address if the label is too long."""
    text = target_name(label)
    return text if len(text) <= _MAX_CALLSIGN_LENGTH else f"T{icao_address(label):06X}"


def adsb_messages(picture: Picture, frame: LocalFrame, t_ns: int) -> Iterator[Message]:
    """Yield a message for each track in the estimate, ordered by label."""
    age_s = min(max((t_ns - picture.scan_t_ns) // NS_PER_S, 0), 255)
    for track in picture.tracks:
        if track.estimated and all(math.isfinite(value) for value in track.mean):
            yield _message(track, frame, age_s)


def _message(track: Track, frame: LocalFrame, age_s: int) -> Message:
    east_m, north_m, v_east_m_s, v_north_m_s = (float(value) for value in track.mean)
    lat_deg, lon_deg = frame.to_geodetic(east_m, north_m)
    heading_deg = math.degrees(math.atan2(v_east_m_s, v_north_m_s)) % 360.0
    speed_cm_s = min(round(math.hypot(v_east_m_s, v_north_m_s) * 100.0), _MAX_CM_S)
    return dialect.MAVLink_adsb_vehicle_message(
        icao_address(track.label),
        round(lat_deg * 1e7),
        round(lon_deg * 1e7),
        dialect.ADSB_ALTITUDE_TYPE_GEOMETRIC,
        round(frame.alt_msl_m * 1e3),
        round(heading_deg * 100.0) % 36_000,
        speed_cm_s,
        0,
        callsign(track.label).encode("ascii"),
        dialect.ADSB_EMITTER_TYPE_NO_INFO,
        age_s,
        _FLAGS,
        0,
    )
