"""From a grid path to a route that a fixed wing can fly: string pulling, turns, first turns."""
