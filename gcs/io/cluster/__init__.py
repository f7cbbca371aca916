"""Parts of the service in several processes, connected by zenoh: bridges and their lease, and command."""
