"""GLMB tracking with motion and measurement models that the user gives as functions."""
