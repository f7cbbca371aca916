"""Commands before a flight: mission files, plans, vehicles, keys."""
