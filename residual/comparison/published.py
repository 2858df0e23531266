"""Figures as published, to be printed beside measured ones."""

from __future__ import annotations

TABLE_9 = {
    "captive MMG": ((0.272,), (0.858,), (1.015,), (0.036,), (0.189,), (0.100,)),
    "Type-1: rnn-window, state loss, TZRB+": (
        (0.236, 0.003), (0.713, 0.011), (0.086, 0.063), (0.052, 0.024), (0.069, 0.014), (0.138, 0.023)
    ),
    "Type-2: rnn, state loss, TZRB+": (
        (0.241, 0.005), (0.728, 0.017), (0.124, 0.141), (0.058, 0.031), (0.140, 0.101), (0.167, 0.053)
    ),
    "Type-3: rnn-window, acceleration loss, TZRB+": (
        (4834, 4041), (0.864, 0.100), (761.1, 1519), (634.8, 1264), (91.76, 124.6), (1.163, 0.617)
    ),
    "Type-4: rnn-window, state loss, TZB": (
        (0.488, 0.022), (0.701, 0.019), (0.122, 0.054), (0.144, 0.053), (0.246, 0.107), (0.302, 0.062)
    ),
    "Type-5: rnn-window, state loss, TZRB": (
        (0.262, 0.007), (0.785, 0.024), (0.856, 0.288), (0.055, 0.030), (0.182, 0.047), (0.294, 0.043)
    ),
}  # fmt: skip
"""Wakita et al. (2022), Table 9: mean and standard deviation over five seeds of Eq. 25, per record of TABLE_9_TEST."""
TABLE_9_TEST = ("Random", "Turning", "Zigzag", "Berthing1", "Berthing2", "Berthing3")
TABLE_9_NOTE = (
    "As published by Wakita et al. (2022, Table 9), not like for like: its six test records are not those tested here "
    "unless --test test names them; sigma is pooled over its own test set; only the random and the turning record are "
    "restarted every 100 s, the others run in one piece; a windowed network is given the first second as measured."
)
