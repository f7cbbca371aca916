"""Who controls a vehicle, and what others wrote to it."""
