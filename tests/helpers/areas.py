"""Local frames of missions, each with a map of 3 km by 3 km; more keys of ``[map]`` may follow."""

_MAP = """
[map]
width_m = 3000.0
height_m = 3000.0
nodes_east = 76
nodes_north = 76
"""

AUSTRALIA = f"""
[frame]
lat_deg = -35.372275
lon_deg = 149.148714
alt_msl_m = 584.0
{_MAP}"""

ALABAMA = f"""
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
{_MAP}"""
