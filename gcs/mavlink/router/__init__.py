"""Routes between vehicles and other ground stations, and what these may send."""
