"""A mission file of a field with a fence."""

from gcs.geo import LocalFrame

FRAME = LocalFrame(33.2, -87.6, 70.0)
FIELD = """
name = "fenced"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
[map]
width_m = 2000.0
height_m = 2000.0
nodes_east = 51
nodes_north = 51
[[agents]]
system_id = 1
east_m = 400.0
north_m = 700.0
course_deg = 90.0
[[births]]
east_m = {east_m}
north_m = {north_m}
[airframe]
speed_m_s = 22.0
bank_deg = 45.0
[planning]
clearance_m = {clearance_m}
shape = "flyable"
[mission]
loiter_radius_m = 80.0
accept_radius_m = 30.0
[fence]
[[fence.areas]]
kind = "inclusion"
corners_deg = {corners_deg}
[simulation]
forward_speed_m_s = 22.0
airframe = "banked"
[[simulation.targets]]
east_m = {east_m}
north_m = {north_m}
"""

WIDE, NARROW = (100.0, 100.0, 1400.0, 1400.0), (100.0, 600.0, 1400.0, 800.0)


def field(target_m, fence_m=WIDE, clearance_m=60.0):
    """Return a mission file with a target and a fence: west, south, east, north."""
    west, south, east, north = fence_m
    corners = [(west, south), (east, south), (east, north), (west, north)]
    return FIELD.format(
        east_m=target_m[0],
        north_m=target_m[1],
        clearance_m=clearance_m,
        corners_deg=[list(FRAME.to_geodetic(*corner)) for corner in corners],
    )
