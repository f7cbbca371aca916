"""Orders of an operator, approval of plans, and replies."""
