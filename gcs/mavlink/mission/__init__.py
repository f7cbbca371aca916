"""The mission protocol (https://mavlink.io/en/services/mission.html) for missions, fences and rally points.

`items` (MISSION_ITEM_INT), `item_builder` (a mission as items of a firmware), `geofence_rally` (fence and
rally items), `item_transfer` (MissionDownload and MissionUpload).

An upload with its read-back begins in `upload_kinds`. `upload_rules` is the table of what follows on what, in
the vocabulary of `upload_stages`; `upload` carries it out on the records of `upload_state`, with events from
`upload_events`, and timeouts, bounds and policy from `upload_limits`.
"""
