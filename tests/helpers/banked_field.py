"""Begin of a mission file: a field of three kilometres, and aeroplanes that bank, climb and sink."""

BANKED_FIELD = """
name = "field"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
[map]
width_m = 3000.0
height_m = 3000.0
nodes_east = 61
nodes_north = 61
[airframe]
speed_m_s = 15.0
bank_deg = 35.0
climb_m_s = 4.0
sink_m_s = 3.0
"""
