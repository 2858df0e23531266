"""Effects that a gap between model and trial may consist of: one file each, one object each.

An effect is switched on by the synthetic generator, freed by a fit and screened by the diagnosis. EFFECTS lists them
in the order in which they enter the model; adding one is adding its file and its line here.
"""

from mmg.effects import (
    antenna_offset,
    bank,
    control_delay,
    current,
    disturbance,
    draft,
    fouling,
    gnss_delay,
    gyro,
    heading_bias,
    hull_memory,
    log_scale,
    propeller_side_force,
    rudder_backlash,
    rudder_lag,
    rudder_offset,
    rudder_stall,
    shallow_water,
    tow,
    velocity_lag,
    wave_drift,
    wind_force,
    wind_sensor_bias,
)
from mmg.effects.effect import Effect, Parameter

EFFECTS: dict[str, Effect] = {
    module.EFFECT.name: module.EFFECT
    for module in (
        draft, current, wind_sensor_bias, control_delay, rudder_lag, rudder_backlash, rudder_offset,
        wind_force, propeller_side_force, rudder_stall, fouling, shallow_water, hull_memory, bank, wave_drift, tow,
        disturbance,
        antenna_offset, gnss_delay, velocity_lag, heading_bias, log_scale, gyro,
    )
}  # fmt: skip


def effect(name: str) -> Effect:
    """The effect of this name; KeyError with the choices if there is none."""
    if name not in EFFECTS:
        raise KeyError(f"effect {name!r} is unknown; known: {', '.join(sorted(EFFECTS))}")
    return EFFECTS[name]


__all__ = ["EFFECTS", "Effect", "Parameter", "effect"]
