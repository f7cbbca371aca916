"""Reports of foreign aircraft, from ADS-B and Remote ID: which are believed, and their errors.

| message | position | height |
|---|---|---|
| ADSB_VEHICLE | its ICAO address names the aircraft | pressure altitude, or geometric |
| OPEN_DRONE_ID_LOCATION | `id_or_mac` names the drone | pressure altitude, else ellipsoid |
| OPEN_DRONE_ID_BASIC_ID | none; serial number or registration | none |

Sources: https://mavlink.io/en/messages/common.html#ADSB_VEHICLE,
https://mavlink.io/en/services/opendroneid.html; units and unknown values of Remote ID are those of ASTM
F3411. Heights are taken as heights above mean sea level, with an error that covers what they are of.
"""

from __future__ import annotations

import math
import zlib
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.separation.separation_state import Aircraft
from gcs.geo import LocalFrame
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.adsb_out import UNASSIGNED_ICAO_BLOCK
from gcs.model import NS_PER_S
from gcs.safe_text import printable

FIRST_ADSB: Final = 1 << 24
"""Number of the aircraft with ICAO address 0; those of our vehicles are lower."""
_FIRST_REMOTE_ID: Final = 1 << 25
"""Numbers of drones by Remote ID begin here: 24 bits of a checksum of what names them."""
_MAX_DISTANCE_M: Final = 50_000.0
_MAX_SPEED_M_S: Final = 400.0
_PRESSURE_ERROR_M: Final = 100.0
_GEOMETRIC_ERROR_M: Final = 30.0
_ELLIPSOID_ERROR_M: Final = 110.0
"""The geoid is 107 m below to 86 m above the ellipsoid."""
_NEEDED: Final[int] = dialect.ADSB_FLAGS_VALID_COORDS | dialect.ADSB_FLAGS_VALID_ALTITUDE
_MOTION: Final[int] = dialect.ADSB_FLAGS_VALID_HEADING | dialect.ADSB_FLAGS_VALID_VELOCITY
_NO_HEIGHT_M: Final = -1000.0
_NO_DIRECTION: Final = 36_100
_NO_SPEED: Final = 25_500
_NO_CLIMB: Final = 6_300


def traffic_report(message: Message, frame: LocalFrame, t_ns: int) -> tuple[int, Aircraft | None]:
    """Return number and report of an aircraft; None if it has no position or height, or is far away."""
    if message.get_type() == "ADSB_VEHICLE":
        number = FIRST_ADSB + message.ICAO_address
        report = _adsb(message, frame, t_ns)
    else:
        number = remote_id_number(message)
        report = _remote_id(message, frame, t_ns)
    if report is None or math.hypot(report.east_m, report.north_m) > _MAX_DISTANCE_M:
        return number, None
    return number, report if report.speed_m_s <= _MAX_SPEED_M_S else None


def traffic_name(number: int) -> str:
    """Return an aircraft in words, without its callsign."""
    if number >= _FIRST_REMOTE_ID:
        return f"drone {number - _FIRST_REMOTE_ID:06X}"
    return f"aircraft {number - FIRST_ADSB:06X}"


def remote_id_number(message: Message) -> int:
    """Return the number of a drone by Remote ID."""
    return _FIRST_REMOTE_ID + (zlib.crc32(bytes(message.id_or_mac)) & 0xFFFFFF)


def uas_id(message: Message) -> str:
    """Return the serial number or registration in an OPEN_DRONE_ID_BASIC_ID."""
    return printable(bytes(message.uas_id).split(b"\0")[0].decode("ascii", "replace").strip())


def _adsb(message: Message, frame: LocalFrame, t_ns: int) -> Aircraft | None:
    is_valid = message.flags & _NEEDED == _NEEDED and _is_on_earth(message.lat, message.lon)
    if not is_valid or not 0 <= message.ICAO_address < UNASSIGNED_ICAO_BLOCK:
        return None  # the block is used for target tracks that we send
    east_m, north_m = frame.to_local(message.lat * 1e-7, message.lon * 1e-7)
    is_moving = message.flags & _MOTION == _MOTION
    is_climbing = bool(message.flags & dialect.ADSB_FLAGS_VERTICAL_VELOCITY_VALID)
    is_geometric = message.altitude_type == dialect.ADSB_ALTITUDE_TYPE_GEOMETRIC
    return Aircraft(
        t_ns=t_ns - message.tslc * NS_PER_S,
        east_m=east_m,
        north_m=north_m,
        alt_msl_m=message.altitude * 1e-3,
        speed_m_s=message.hor_velocity * 0.01 if is_moving else 0.0,
        course_rad=math.radians(message.heading * 0.01) if is_moving else 0.0,
        climb_m_s=message.ver_velocity * 0.01 if is_climbing else 0.0,
        height_error_m=_GEOMETRIC_ERROR_M if is_geometric else _PRESSURE_ERROR_M,
        callsign=printable(message.callsign.strip()),
    )


def _remote_id(message: Message, frame: LocalFrame, t_ns: int) -> Aircraft | None:
    is_of_other = any(message.id_or_mac)  # else a vehicle describes itself to its transmitter
    is_on_ground = message.status == dialect.MAV_ODID_STATUS_GROUND
    has_position = _is_on_earth(message.latitude, message.longitude) and (
        message.latitude or message.longitude
    )
    heights_m = (message.altitude_barometric, message.altitude_geodetic)
    known = [
        (height_m, error_m)
        for height_m, error_m in zip(heights_m, (_PRESSURE_ERROR_M, _ELLIPSOID_ERROR_M), strict=True)
        if math.isfinite(height_m) and height_m > _NO_HEIGHT_M
    ]
    if not is_of_other or is_on_ground or not has_position or not known:
        return None
    east_m, north_m = frame.to_local(message.latitude * 1e-7, message.longitude * 1e-7)
    is_moving = message.speed_horizontal < _NO_SPEED and message.direction < _NO_DIRECTION
    alt_msl_m, height_error_m = known[0]
    return Aircraft(
        t_ns=t_ns,
        east_m=east_m,
        north_m=north_m,
        alt_msl_m=alt_msl_m,
        speed_m_s=message.speed_horizontal * 0.01 if is_moving else 0.0,
        course_rad=math.radians(message.direction * 0.01) if is_moving else 0.0,
        climb_m_s=message.speed_vertical * 0.01 if abs(message.speed_vertical) < _NO_CLIMB else 0.0,
        height_error_m=height_error_m,
        callsign="",
    )


def _is_on_earth(lat_e7: int, lon_e7: int) -> bool:
    return abs(lat_e7) <= 900_000_000 and abs(lon_e7) <= 1_800_000_000
