"""MAVSDK as an uploader, in a process of its own."""
