"""Take-offs: clear climbs, and one vehicle after another."""
