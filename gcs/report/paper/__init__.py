"""Claims and figures of the paper, checked by runs."""
