"""Dimensions of the office in our world (metres, z up), measured in the original's depth images."""

from itertools import product

X0, X1 = -2.5, 2.5
Y0, Y1 = -3.7, 3.7
Z0, Z1 = 3.0, 5.4  # fitted planes of 17 official frames: 3.0000 and 5.3994, spread 0.2 mm
DESK_TOP = 0.81  # above the floor
PANEL = 0.5
#: Centres of the luminaires, each a pair of ceiling panels 1.0 x 0.5 m.
LUMINAIRES = tuple((x, y) for y, x in product((-2.75, -1.25, 0.25, 1.75, 3.25), (-1.0, 1.0)))
VENTS = ((0.0, -2.0), (-2.0, 0.0), (2.0, 0.5), (0.0, 2.5))
#: How far the rails, the frames of the luminaires and the vents are below the panels, in the depth
#: of two official frames. The noise model drops surfaces seen at an angle over 82 degrees: with
#: higher ones it spoils every corner of the ceiling, which the original's does not.
RAIL = 0.0011
LOW = 0.0061
VENT_LOW = 0.0101
DOOR = (1.38, 2.24, 2.06)  # in the end wall y = Y1: low x, high x, height
