"""Routes between vehicles and other ground stations (`router`), and what those may send (`access_policy`)."""
