"""Routes between vehicles and other ground stations (`router`), and their access (`access_policy`)."""
