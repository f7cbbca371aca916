"""From scans and position reports to confirmed tracks, and from tracks to the status of each agent."""
