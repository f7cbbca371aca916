"""The GLMB filter: prediction, gating, association, update, and extraction of estimates."""
