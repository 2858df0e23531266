"""Open water of Wageningen B-screws: K_T as a polynomial of J, P/D, A_E/A_O and Z at Re = 2e6.

K_T = sum C J^s (P/D)^t (A_E/A_O)^u Z^v, 39 terms (Oosterveld & van Oossanen 1975, Int. Shipb. Progress 22:251-262).
Valid for 2 <= Z <= 7, A_E/A_O 0.3 to 1.05, P/D 0.5 to 1.4, J >= 0. Table as in several
public codes; check value Z = 4, A_E/A_O = 0.70, P/D = 0.7151: K_T(0, 0.4, 0.8) = 0.3100, 0.1688, -0.0149.
"""

from __future__ import annotations

import numpy as np

_K_T = """
0.00880496 0 0 0 0; -0.204554 1 0 0 0; 0.166351 0 1 0 0; 0.158114 0 2 0 0; -0.147581 2 0 1 0; -0.481497 1 1 1 0;
0.415437 0 2 1 0; 0.0144043 0 0 0 1; -0.0530054 2 0 0 1; 0.0143481 0 1 0 1; 0.0606826 1 1 0 1; -0.0125894 0 0 1 1;
0.0109689 1 0 1 1; -0.133698 0 3 0 0; 0.00638407 0 6 0 0; -0.00132718 2 6 0 0; 0.168496 3 0 1 0; -0.0507214 0 0 2 0;
0.0854559 2 0 2 0; -0.0504475 3 0 2 0; 0.010465 1 6 2 0; -0.00648272 2 6 2 0; -0.00841728 0 3 0 1; 0.0168424 1 3 0 1;
-0.00102296 3 3 0 1; -0.0317791 0 3 1 1; 0.018604 1 0 2 1; -0.00410798 0 2 2 1; -0.000606848 0 0 0 2;
-0.0049819 1 0 0 2; 0.0025983 2 0 0 2; -0.000560528 3 0 0 2; -0.00163652 1 2 0 2; -0.000328787 1 6 0 2;
0.000116502 2 6 0 2; 0.000690904 0 0 1 2; 0.00421749 0 3 1 2; 0.0000565229 3 6 1 2; -0.00146564 0 3 2 2
"""
TERMS = np.array([row.split() for row in _K_T.split(";")], dtype=float)  # Rows (C, s, t, u, v), (39, 5)


def thrust_coefficient(J: np.ndarray, pitch_ratio: float, area_ratio: float, blades: int) -> np.ndarray:
    """K_T at advance ratios J (N,) for P/D, A_E/A_O and Z, (N,): pitch_ratio, area_ratio, blades in this order."""
    C, s, t, u, v = TERMS.T
    return (C * pitch_ratio**t * area_ratio**u * float(blades) ** v) @ np.asarray(J, dtype=float)[None] ** s[:, None]


def thrust_parabola(pitch_ratio: float) -> tuple[float, float, float]:
    """k_0, k_1, k_2 of K_T = k_0 + k_1 J + k_2 J^2 for A_E/A_O = 0.6 and Z = 4, least squares over 0 <= J <= P/D.
    pitch_ratio: P/D."""
    J = np.linspace(0.0, pitch_ratio, 50)  # beyond J of about P/D the thrust is negative
    k_2, k_1, k_0 = np.polyfit(J, thrust_coefficient(J, pitch_ratio, 0.6, 4), 2)
    return float(k_0), float(k_1), float(k_2)
