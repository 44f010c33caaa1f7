"""Sizes and colours that the page and the files for other viewers share."""

FORCE_LENGTH = 0.1
"""Length of the arrow of a force, m/N."""
TORQUE_LENGTH = 0.3
"""Length of the arrow of a torque, m/(N m)."""
FORCE = (220, 60, 40)
"""Colour of a force, RGB."""
TORQUE = (150, 60, 200)
"""Colour of a torque, RGB."""
