"""Torch networks on a calibrated ship: physics as a torch operator, systems, rollouts, training, decision."""
