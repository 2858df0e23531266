"""From model to ship: similarity, friction, wake and rudder inflow at another length, and what they leave open."""
