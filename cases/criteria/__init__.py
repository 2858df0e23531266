"""Figures of manoeuvres (advance, overshoot, stopping distance, ...) and the IMO criteria they are judged by.

Constants of this room that name no source are set by hand.
"""
