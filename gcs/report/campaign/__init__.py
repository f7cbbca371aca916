"""Campaigns of many missions: results with confidence intervals, tables and page."""
