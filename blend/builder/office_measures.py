"""Dimensions of the office in our world (metres, z up), measured in the original's depth images."""

X0, X1 = -2.5, 2.5
Y0, Y1 = -3.7, 3.7
Z0, Z1 = 3.0, 5.4  # fitted planes of 17 official frames: 3.0000 and 5.3994, spread 0.2 mm
DESK_TOP = 0.81  # above the floor
PANEL = 0.5
#: Centres of the luminaires, each a pair of ceiling panels 1.0 x 0.5 m.
LUMINAIRES = tuple((x, y) for y in (-2.75, -1.25, 0.25, 1.75, 3.25) for x in (-1.0, 1.0))
VENTS = ((0.0, -2.0), (-2.0, 0.0), (2.0, 0.5), (0.0, 2.5))
DOOR = (1.38, 2.24, 2.06)  # in the end wall y = Y1: low x, high x, height
