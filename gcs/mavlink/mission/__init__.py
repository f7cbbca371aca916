"""The mission protocol (https://mavlink.io/en/services/mission.html): missions, fences, rally points."""
