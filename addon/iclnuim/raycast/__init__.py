"""Ray casting (Embree, by embreex), distances to triangles (libigl), visibility, and independent
checks of rendered depth.
"""
