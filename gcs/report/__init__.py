"""Scores, summaries and figures of a run."""
