"""One run: its timeline, evaluation, tables and page."""
