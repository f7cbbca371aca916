"""Motion, sensors, clutter and births: the models that the filter is given."""
