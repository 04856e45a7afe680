"""Files in and out: trajectories of every dialect, EXR, PNG, recipes. Each conversion names the frame it comes from."""
