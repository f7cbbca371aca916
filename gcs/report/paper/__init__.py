"""The paper's claims and figures, held against runs."""
