"""Files in and out: trajectories of every format, EXR, PNG, recipes. Each conversion names the frame it comes from."""
