"""Dimensions of the living room in our world (metres, z up), measured in the original's depth
images.
"""

X0, X1 = -2.425, 2.511
Y0, Y1 = -3.091, 1.929
Z0, Z1 = 0.133, 2.633
# above the floor
SKIRT_TOP = 0.145
SKIRT_THICK = 0.025
DOOR = (1.092, 2.300, 2.175)  # casing: low x, high x, top z
WINDOW = (-2.30, 0.04, 0.138, 2.470)  # opening in the window wall: low x, high x, low z, high z
SPOTS = ((-0.225, 1.66), (2.26, -0.785), (-0.225, -2.45), (-1.90, -0.785))
LAMPS = {"corner": (-2.09, 1.51), "window": (2.03, -2.61)}
