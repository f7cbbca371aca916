"""Clusters of labels: contention for detections, merging, splitting, singletons."""
