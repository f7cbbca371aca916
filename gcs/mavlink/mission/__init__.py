"""The mission protocol (https://mavlink.io/en/services/mission.html) for missions, fences and rally points.

`items` (MISSION_ITEM_INT), `item_builder` (a mission as items of a firmware), `geofence_rally` (fence and
rally items), `item_transfer` (MissionDownload and MissionUpload). `list_upload` is an upload with its
read-back. Tasks on top of it: `list_task` (fence, rally points) and `upload_task` (missions, with its
single steps in `upload_steps`). Stages, transitions and results are in `upload_stages`, timeouts, bounds
and policy in `upload_limits`.
"""
