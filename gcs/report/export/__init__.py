"""Maps of runs for other programs.

``run_map``    `RunMap`: flown paths, planned routes, targets and losses, in degrees and heights MSL
``kml``        KML 2.2, for Google Earth and QGroundControl
``mission_frame``  frame, ground and altitude layers of a mission: places, routes
``target_ellipse`` last estimate of a target with its ellipse
``features``   GeoJSON (RFC 7946)
``gpx``        GPX 1.1
``foxglove``   messages for Foxglove; ``foxglove_records`` has its well-known schemas
"""
