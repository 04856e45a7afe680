"""Rays against triangles (Embree, through open3d), distances to them (libigl), what is seen, and independent checks of rendered depth."""
