"""Commands after a flight: replay, report, info, track."""
