"""Scans that sensors publish on zenoh, read with all checks.

A scan's JSON differs from the record (``docs/sensors.md``): it has the origin of its local frame and no time
of arrival, and a range-bearing sensor sends ranges and bearings, which become east/north here. A third number
of each detection is its height.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import lru_cache
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from gcs.errors import WireError
from gcs.geo import LocalFrame
from gcs.io.record_json import decode_json
from gcs.io.zenoh.key_expressions import SENSOR_NAME
from gcs.model import FloatArray, Polar, Scan, Sensor, Viewpoint, read_only
from gcs.tracking.models.sensor_geometry import map_coordinates, polar_sensor, sensor_coordinates

MAX_DETECTIONS = 20_000
MAX_ORIGIN_OFFSET_M = 1.0
"""Greatest distance of a sensor's origin from the mission's."""

_SCAN_KEY = re.compile(r"swarm/[^/]+/sensor/(?P<sensor>[^/]+)/scan")

_Name = Annotated[str, Meta(pattern=SENSOR_NAME)]
_Probability = Annotated[float, Meta(ge=0.0, le=1.0)]
_Metres = Annotated[float, Meta(ge=-1e7, le=1e7)]
_Variance = Annotated[float, Meta(ge=-1e10, le=1e10)]
_Row = tuple[_Variance, _Variance]
_Range = Annotated[float, Meta(ge=0.0, le=1e7)]
_Bearing = Annotated[float, Meta(ge=-7.0, le=7.0)]
_Height = Annotated[float, Meta(ge=-1000.0, le=100_000.0)]
_Nanoseconds = Annotated[int, Meta(ge=0, le=2**63 - 1)]


class Detection(msgspec.Struct, array_like=True, forbid_unknown_fields=True, frozen=True):
    """A detection of a position sensor: an array of two or three numbers."""

    east_m: _Metres
    north_m: _Metres
    alt_msl_m: _Height | None = None


class PolarDetection(msgspec.Struct, array_like=True, forbid_unknown_fields=True, frozen=True):
    """A detection of a range-bearing sensor: an array of two or three numbers."""

    range_m: _Range
    bearing_rad: _Bearing
    alt_msl_m: _Height | None = None


class OriginMessage(msgspec.Struct, frozen=True, kw_only=True):
    """WGS84 origin of the sensor's east/north."""

    lat_deg: Annotated[float, Meta(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, Meta(ge=-180.0, le=180.0)]


class SensorMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Sensor model of a position sensor, in each of its scans."""

    name: _Name
    detection_probability: _Probability
    clutter_density_per_m2: Annotated[float, Meta(ge=0.0, le=1.0)]
    noise_cov_m2: tuple[_Row, _Row]
    field_of_view_m: tuple[_Metres, _Metres, _Metres, _Metres]
    place_m: tuple[_Metres, _Metres] | None = None
    alt_msl_m: _Height | None = None
    height_agl_m: _Height | None = None


class ScanMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Scan of a position sensor. Unknown fields are ignored."""

    sensor: SensorMessage
    origin: OriginMessage
    measured_t_ns: _Nanoseconds
    z_m: Annotated[list[Detection], Meta(max_length=MAX_DETECTIONS)]


class PolarSensorMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Sensor model of a range-bearing sensor."""

    name: _Name
    detection_probability: _Probability
    clutter_density_per_m_rad: Annotated[float, Meta(ge=0.0, le=1e6)]
    place_m: tuple[_Metres, _Metres]
    range_std_m: Annotated[float, Meta(ge=0.0, le=1e5)]
    bearing_std_rad: Annotated[float, Meta(ge=0.0, le=math.pi)]
    least_range_m: _Range = 0.0
    most_range_m: Annotated[float, Meta(gt=0.0, le=1e7)]
    sector_centre_rad: _Bearing = 0.0
    sector_width_rad: Annotated[float, Meta(gt=0.0, le=7.0)] = 2.0 * math.pi
    alt_msl_m: _Height | None = None
    height_agl_m: _Height | None = None
    range: Literal["ground", "slant"] = "ground"


class PolarScanMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Scan of a range-bearing sensor."""

    sensor: PolarSensorMessage
    origin: OriginMessage
    measured_t_ns: _Nanoseconds
    z_range_bearing: Annotated[list[PolarDetection], Meta(max_length=MAX_DETECTIONS)]


class _SensorKind(msgspec.Struct, frozen=True):
    kind: Literal["position", "range_bearing"] = "position"


class _ScanKind(msgspec.Struct, frozen=True):
    sensor: _SensorKind


_kind_decoder = msgspec.json.Decoder(_ScanKind)
_scan_decoder = msgspec.json.Decoder(ScanMessage)
_polar_scan_decoder = msgspec.json.Decoder(PolarScanMessage)


def encode_scan(scan: Scan, frame: LocalFrame) -> bytes:
    """Return a scan as a sensor publishes it, with the origin of `frame`."""
    origin = OriginMessage(lat_deg=frame.lat_deg, lon_deg=frame.lon_deg)
    message: dict[str, Any] = {"origin": origin, "measured_t_ns": scan.measured_t_ns}
    sensor = scan.sensor
    polar = sensor.polar
    if polar is None:
        message["sensor"] = {
            "name": sensor.name,
            "detection_probability": sensor.detection_probability,
            "clutter_density_per_m2": sensor.clutter_density_per_m2,
            "noise_cov_m2": sensor.noise_cov_m2.tolist(),
            "field_of_view_m": sensor.field_of_view_m,
        }
        if sensor.viewpoint is not None:
            message["sensor"]["place_m"] = (sensor.viewpoint.east_m, sensor.viewpoint.north_m)
        message["z_m"] = _rows(scan.z_m, scan.heights_msl_m)
    else:
        message["sensor"] = {
            "name": sensor.name,
            "kind": "range_bearing",
            "detection_probability": sensor.detection_probability,
            "clutter_density_per_m_rad": polar.clutter_per_m_rad,
            "place_m": (polar.east_m, polar.north_m),
            "range_std_m": polar.range_std_m,
            "bearing_std_rad": polar.bearing_std_rad,
            "least_range_m": polar.range_m[0],
            "most_range_m": polar.range_m[1],
            "sector_centre_rad": polar.bearing_rad[0],
            "sector_width_rad": 2.0 * polar.bearing_rad[1],
            "range": "slant" if polar.is_slant else "ground",
        }
        message["z_range_bearing"] = _rows(sensor_coordinates(sensor, scan.z_m), scan.heights_msl_m)
    if sensor.viewpoint is not None:
        name = "height_agl_m" if sensor.viewpoint.is_agl else "alt_msl_m"
        message["sensor"][name] = sensor.viewpoint.height_m
    return msgspec.json.encode(message)


def _rows(z: FloatArray, heights_msl_m: FloatArray | None) -> list[list[float]]:
    columns = z if heights_msl_m is None else np.column_stack([z, heights_msl_m])
    rows: list[list[float]] = columns.tolist()
    return rows


def decode_scan(key: str, payload: bytes, t_ns: int, frame: LocalFrame) -> Scan:
    """Return the scan of a payload, after all checks.

    Parameters
    ----------
    key : str
        Key on which it was published.
    t_ns : int
        Time of arrival.
    frame : LocalFrame
        Frame of the mission; a scan of another one is refused.

    Raises
    ------
    WireError
        The payload does not have the form of ``docs/sensors.md``.
    """
    if decode_json(key, payload, _kind_decoder).sensor.kind == "range_bearing":
        polar_message = decode_json(key, payload, _polar_scan_decoder)
        _check_origin(key, polar_message.origin, frame)
        polar = _validated_polar(key, polar_message.sensor)
        sensor = polar_sensor(polar_message.sensor.name, polar_message.sensor.detection_probability, polar)
        viewpoint = _viewpoint(key, polar_message.sensor, polar_message.sensor.place_m)
        sensor = replace(sensor, viewpoint=viewpoint)
        detections = polar_message.z_range_bearing
        z_m = map_coordinates(polar, np.reshape([(d.range_m, d.bearing_rad) for d in detections], (-1, 2)))
        heights = _heights_msl_m(key, "z_range_bearing", [d.alt_msl_m for d in detections])
        return Scan(t_ns, polar_message.measured_t_ns, sensor, read_only(z_m), heights)
    message = decode_json(key, payload, _scan_decoder)
    _check_origin(key, message.origin, frame)
    sensor = _validated_sensor(key, message.sensor)
    z_m = np.reshape([(d.east_m, d.north_m) for d in message.z_m], (-1, 2))
    heights = _heights_msl_m(key, "z_m", [d.alt_msl_m for d in message.z_m])
    return Scan(t_ns, message.measured_t_ns, sensor, read_only(z_m), heights)


def _heights_msl_m(key: str, field: str, heights: list[float | None]) -> FloatArray | None:
    """Return the heights of the detections; None without any."""
    measured = [height for height in heights if height is not None]
    if not measured:
        return None
    if len(measured) < len(heights):
        raise WireError(key, f"{field}: expected a height in every detection, or in none")
    return read_only(measured)


def _viewpoint(
    key: str, message: SensorMessage | PolarSensorMessage, place_m: tuple[float, float] | None
) -> Viewpoint | None:
    if message.alt_msl_m is not None and message.height_agl_m is not None:
        raise WireError(key, "sensor: expected alt_msl_m or height_agl_m, not both")
    height_m = message.height_agl_m if message.alt_msl_m is None else message.alt_msl_m
    if height_m is None:
        return None
    if place_m is None:
        raise WireError(key, "sensor.place_m: expected the place of a sensor that has a height")
    return Viewpoint(*place_m, height_m, is_agl=message.alt_msl_m is None)


def _validated_sensor(key: str, message: SensorMessage) -> Sensor:
    _check_name(key, message.name)
    (a, b), (c, d) = message.noise_cov_m2
    if a < 0.0 or d < 0.0:
        raise WireError(key, f"sensor.noise_cov_m2: a variance cannot be negative, got {a} and {d}")
    if not math.isclose(b, c, rel_tol=1e-9, abs_tol=1e-12):
        raise WireError(key, f"sensor.noise_cov_m2: a covariance is symmetric, got {b} and {c}")
    if b * b > a * d * (1.0 + 1e-9):
        raise WireError(key, f"sensor.noise_cov_m2: not positive semi-definite: {b}**2 > {a} * {d}")
    east_min, north_min, east_max, north_max = message.field_of_view_m
    if not (east_min < east_max and north_min < north_max):
        raise WireError(
            key, "sensor.field_of_view_m: expected [east_min, north_min, east_max, north_max] with min < max"
        )
    return Sensor(
        message.name,
        message.detection_probability,
        message.clutter_density_per_m2,
        read_only(message.noise_cov_m2),
        message.field_of_view_m,
        viewpoint=_viewpoint(key, message, message.place_m),
    )


def _validated_polar(key: str, message: PolarSensorMessage) -> Polar:
    _check_name(key, message.name)
    if not message.least_range_m < message.most_range_m:
        raise WireError(key, "sensor.most_range_m: expected more than least_range_m")
    is_slant = message.range == "slant"
    if is_slant and message.alt_msl_m is None and message.height_agl_m is None:
        raise WireError(
            key, 'sensor.range: "slant" needs the height of the sensor: alt_msl_m or height_agl_m'
        )
    return Polar(
        *message.place_m,
        message.range_std_m,
        message.bearing_std_rad,
        (message.least_range_m, message.most_range_m),
        (message.sector_centre_rad, min(message.sector_width_rad / 2.0, math.pi)),
        message.clutter_density_per_m_rad,
        is_slant,
    )


def _check_name(key: str, name: str) -> None:
    match = _SCAN_KEY.fullmatch(key)
    if match is None:
        raise WireError(key, "not a key for scans, which is swarm/<mission>/sensor/<name>/scan")
    if name != match["sensor"]:
        raise WireError(key, f"sensor.name: `{name}` published on the key of `{match['sensor']}`")


def _check_origin(key: str, origin: OriginMessage, frame: LocalFrame) -> None:
    offset_m = _origin_offset_m(frame, origin)
    if not offset_m <= MAX_ORIGIN_OFFSET_M:
        raise WireError(
            key,
            f"origin: ({origin.lat_deg}, {origin.lon_deg}) lies {offset_m:.1f} m from the "
            f"mission's origin ({frame.lat_deg}, {frame.lon_deg}); give east/north in the mission's frame",
        )


@lru_cache(maxsize=256)
def _origin_offset_m(frame: LocalFrame, origin: OriginMessage) -> float:
    return math.hypot(*frame.to_local(origin.lat_deg, origin.lon_deg))
