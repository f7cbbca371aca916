"""The GLMB filter. Start with `filter` (interface) and `recursion` (equations)."""
