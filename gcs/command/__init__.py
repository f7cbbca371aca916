"""The fold: the one place where tracking, planning and the vehicle links meet."""
