"""Steering gear and engine: from orders to positions, where a ship's inputs are orders and not positions."""
