"""Particulars that the force models use, in words and with their units."""

PARTICULARS = {
    "L": ("length between perpendiculars", "m"),
    "B": ("breadth", "m"),
    "d": ("draught", "m"),
    "m": ("mass", "kg"),
    "x_G": ("centre of gravity, forward of midship", "m"),
    "C_b": ("block coefficient", "-"),
    "rho": ("water density", "kg/m³"),
    "D_P": ("propeller diameter", "m"),
    "pitch_ratio": ("propeller pitch / diameter", "-"),
    "A_R": ("rudder area", "m²"),
    "aspect_ratio": ("rudder aspect ratio", "-"),
    "x_R": ("rudder, forward of midship", "m"),
    "A_T": ("frontal projected area above water", "m²"),
    "A_L": ("lateral projected area above water", "m²"),
    "A_OD": ("lateral area of superstructures on deck", "m²"),
    "C": ("centre of A_L, forward of midship", "m"),
    "C_BR": ("centre of superstructure, forward of midship", "m"),
    "H_BR": ("height of superstructure top above water", "m"),
    "H_C": ("height of the centre of A_L above water", "m"),
    "rho_a": ("air density", "kg/m³"),
}
"""Particulars of a ship file: words and unit."""
