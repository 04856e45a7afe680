"""Files of trajectories: every format that is read, detected and written."""
