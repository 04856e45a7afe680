"""Rays against triangles (Embree, through embreex), distances to them (libigl), what is seen, and independent checks of rendered depth."""
