"""What is wrong with a sequence: its images, its camera, its poses."""
