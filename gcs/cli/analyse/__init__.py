"""Commands after a flight, for recordings and logs.

- `replay`, `whatif`: a recording played again, with a comparison of results under other settings.
- `report`: a page about a run.
- `info`, `info_recording`, `info_detections`: the contents of a file.
- `track`: a tracker on recorded detections.
"""
