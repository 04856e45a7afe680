"""Rays against triangles (Embree, through open3d): distances, what is seen, and independent checks of rendered depth."""
