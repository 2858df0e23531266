"""Worlds: the ship, the noise and the numerics of a benchmark. None of what follows was used to choose a limit.

A world is integrated for a ship of 3 m; ``length`` is that of the ship in the files, by Froude's law.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import ModuleType

import numpy as np

from benchmarks.blind.generator import forces, forces_standard, forces_vectwin
from benchmarks.blind.generator.controls import TWIN
from benchmarks.blind.generator.surroundings import DRAUGHT

Array = np.ndarray
MODEL = 3.0
"""Length of the ship that is integrated [m]."""

ESSO = (
    "X_0F", "X_0A", "X_vr", "Y_v", "Y_r", "N_v", "N_r", "C_D", "C_rY", "C_rN",
    "k_0", "t_P", "w_P0", "tau",
    "t_R", "a_H", "ell_R", "k_x", "epsilon", "gamma_P", "gamma_N",
)  # fmt: skip
KVLCC2 = (
    "R_0", "X_vv", "X_vvvv", "Y_v", "Y_r", "Y_vvv", "N_v", "N_r", "N_vvr", "N_rrr",
    "k_0", "k_1", "t_P", "w_P0", "C_1", "t_R", "a_H", "ell_R", "kappa", "epsilon", "gamma_R_plus", "gamma_R_minus",
)  # fmt: skip
VECTWIN = (
    "X_0F", "X_vr", "Y_v", "Y_r", "N_v", "N_r", "C_D", "C_rY", "C_rN",
    "a_0", "b_0", "c_0", "c_1", "k_0", "k_1", "k_2",
    "k_x", "k_N", "k_gamma", "e_0", "f_1", "g_0", "g_1", "K_TP_BT", "K_TN_BT", "a_Y1_BT", "a_N1_BT",
)  # fmt: skip


@dataclass(frozen=True)
class World:
    """What is the same in all cases of a benchmark, for a ship of 3 m.

    ship: ship file; length: of the ship in the files [m]; forces: its force model; drawn: coefficients whose truth
    differs from the ship file, with a standard deviation of ``spread`` of each; force: standard deviations of the
    random force X, Y [N], N [N m] before a factor of 0.7 to 1.4; memory: range of its correlation time [s]; noise:
    standard deviations of the errors of x, y [m], psi [rad], u, v [m/s], r [rad/s]; colour: range of the memory of the
    errors of u, v and r [s], (0, 0): white; gyro: largest scale error of r; gust: wind that the log does not show, as
    share of the mean; sample: of the records [s]; without: effects that the ship cannot have; resistance: X_0' that
    fouling adds a share of; draught: by which the depth in a site file is told [m]; soft:
    angle over which the flow at two rudders changes sides [rad]; sizes: factors on the sizes of causes without a name,
    which cost more or less here than in the pond; runge_kutta: fourth order with inputs in between, else Heun; step:
    of the integration and of all signals [s], a whole part of the sample; duration: of a run [s]; wide: every case
    draws its own noise, memory, sample, runs and spread (wide.py).
    """

    name: str
    ship: str = "esso_osaka_3m"
    length: float = MODEL
    forces: ModuleType = forces
    drawn: tuple[str, ...] = ESSO
    spread: float = 0.05
    force: tuple[float, float, float] = (0.05, 0.15, 0.10)
    memory: tuple[float, float] = (3.0, 8.0)
    noise: tuple[float, ...] = (0.01, 0.01, 0.0015, 0.004, 0.004, 0.0006)
    colour: tuple[float, float] = (0.0, 0.0)
    gyro: float = 0.0
    gust: float = 0.0
    sample: float = 0.5
    without: tuple[str, ...] = ()
    runge_kutta: bool = False
    sets: Mapping[str, str] = field(default_factory=dict)
    resistance: float = 0.02139
    draught: float = DRAUGHT
    soft: float = 0.0
    sizes: Mapping[str, float] = field(default_factory=dict)
    step: float = 0.05
    duration: float = 150.0
    wide: bool = False

    @property
    def scale(self) -> float:
        """Length of the ship in the files over that of the ship that is integrated."""
        return self.length / MODEL

    @property
    def rows(self) -> int:
        """Points in time of the integration of a run."""
        return round(self.duration / self.step) + 1

    @property
    def every(self) -> int:
        """Steps of the integration between two rows of the records."""
        return round(self.sample / self.step)

    def widened(self) -> World:
        """The same ship and kinds of errors, where every case draws its own conditions."""
        return replace(self, name=f"{self.name}_wide", wide=True)


TANKER = World(
    "kvlcc2",
    ship="kvlcc2_l7",
    length=7.0,
    forces=forces_standard,
    drawn=KVLCC2,
    force=(0.03, 0.08, 0.06),
    memory=(1.5, 12.0),
    noise=(0.004, 0.004, 0.002, 0.002, 0.003, 0.0004),
    colour=(0.05, 0.4),
    gyro=0.002,
    sample=0.4,
    without=("wind_force", "wind_sensor_bias", "propeller_side_force", "lee_of_a_wall"),
    runge_kutta=True,
    sets={"mixed": "ahead"},
    sizes={
        "thrust_loss_at_high_n": 0.45,
        "roll_coupling": 0.65,
        "rudder_rate_limit": 0.26,
        "jammed_bearing": 0.35,
        "asymmetric_rudder": 0.3,
        "wavy_engine_map": 0.6,
        "thrust_deduction_at_low_advance": 0.7,
        "separation_at_large_drift": 0.45,
        "fish_tailing": 0.6,
        "towed_boat": 0.5,
        "one_sided_fouling": 0.55,
        "weed_patch": 0.6,
        "reversing_stream": 0.6,
        "irregular_swell": 0.6,
    },
)
"""KVLCC2 of 7 m, ahead only."""
NARROW = {
    world.name: world
    for world in (
        World("pond"),
        World("basin", memory=(3.5, 7.0), colour=(0.3, 0.8), gyro=0.005, gust=0.15, sample=0.2, runge_kutta=True),
        TANKER,
        World(
            "vectwin",
            ship="vectwin_3m",
            forces=forces_vectwin,
            drawn=VECTWIN,
            force=(0.04, 0.10, 0.08),
            memory=(2.0, 10.0),
            noise=(0.006, 0.006, 0.001, 0.006, 0.004, 0.0008),
            colour=(0.2, 1.0),
            gyro=0.003,
            gust=0.10,
            sample=0.25,
            step=0.0625,
            without=("propeller_side_force", "rudder_stall", "rudder_stops_short"),
            runge_kutta=True,
            sets={"mixed": TWIN},
            resistance=0.022745,
            draught=0.1721,
            soft=0.06,
            sizes={
                "thrust_loss_at_high_n": 0.25,
                "roll_coupling": 0.5,
                "rudder_rate_limit": 0.15,
                "jammed_bearing": 0.27,
                "steering_dropout": 0.35,
                "passing_ships": 1.2,
                "asymmetric_rudder": 0.4,
                "wavy_engine_map": 0.6,
                "thrust_deduction_at_low_advance": 0.3,
                "ventilating_propeller": 0.45,
                "separation_at_large_drift": 0.45,
                "fish_tailing": 0.55,
                "towed_boat": 0.5,
                "one_sided_fouling": 0.6,
                "weed_patch": 0.65,
                "gathering_weed": 0.7,
                "reversing_stream": 0.7,
                "shaft_droop": 0.3,
                "thrust_drop_in_turn": 0.25,
            },
        ),
        replace(
            TANKER,
            name="sea",
            ship="kvlcc2_full",
            length=320.0,
            force=(0.06, 0.12, 0.05),
            memory=(1.0, 9.0),
            noise=(0.008, 0.008, 0.0012, 0.005, 0.003, 0.0005),
            colour=(0.1, 0.5),
            gyro=0.003,
            sample=0.2,
        ),
    )
}
"""pond: the first one, by which the diagnosis was made; basin: other noise, coloured sensors, unlogged gusts, another
integration; kvlcc2: another ship of 7 m with another force model, other sizes of everything, other manoeuvres;
vectwin: a ship with two rudders, a bow thruster and a propeller that never stops, in a harbour; sea: KVLCC2 herself,
320 m long, by which nothing was made: what the diagnosis takes as a number of metres or seconds would show."""
WORLDS = {**NARROW, **{wide.name: wide for wide in map(World.widened, NARROW.values())}}
"""The same and, as NAME_wide, each with conditions that every case draws anew."""

POWERS = {
    "current.x": 0.5, "current.y": 0.5, "wind_sensor_bias.x": 0.5, "wind_sensor_bias.y": 0.5, "wave_drift.x": 3.0,
    "wave_drift.y": 3.0, "tow.X": 3.0, "tow.Y": 3.0, "tow.N": 4.0, "rudder_lag.T": 0.5, "control_delay.tau": 0.5,
    "gnss_delay.tau": 0.5, "hull_memory.T": 0.5, "antenna_offset.x": 1.0, "antenna_offset.y": 1.0,
    "bank.distance": 1.0, "bank.decay": 1.0,
}  # fmt: skip
"""Powers of the scale by which parameters of the key grow; those that are not here are numbers."""
COLUMNS, AIR = (0.5, 1.0, 1.0, 0.0, 0.5, 0.5, -0.5, -0.5, 0.0), (0.5, 0.0)
"""Powers of the scale of t, x, y, psi, u, v, r, n, delta; of wind speed and direction."""


def sensor_errors(world: World, rows: int, runs: int, rng: np.random.Generator) -> Array:
    """Errors (rows, 6, runs) of the logged columns: white, or those of u, v and r half white and half with memory."""
    out = rng.standard_normal((rows, 6, runs))
    if world.colour[1] > 0:
        left = np.exp(-world.sample / rng.uniform(*world.colour, 3))[:, None]
        slow = rng.standard_normal((rows, 3, runs))
        for k in range(1, rows):
            slow[k] = left * slow[k - 1] + np.sqrt(1 - left**2) * slow[k]
        out[:, 3:] = (out[:, 3:] + slow) / np.sqrt(2.0)
    return np.asarray(world.noise)[:, None] * out
