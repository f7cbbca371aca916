"""The mission protocol (https://mavlink.io/en/services/mission.html) for missions, fences and rally points.

`items` (MISSION_ITEM_INT), `geofence_rally` (fence and rally items), `protocol` (MissionDownload and
MissionUpload). Tasks on top of it: `list_task` (fence, rally points) and `upload_task` (missions). The
latter's stages and results are in `upload_stages`, its timeouts in `upload_timing`, its single steps in
`upload_steps`.
"""
