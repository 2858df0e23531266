"""Standard manoeuvres: their definitions, orders to rudder and propeller, self-propulsion, heading control."""
