"""Where methods fail: perturbations of rising severity, and who keeps tracking."""
