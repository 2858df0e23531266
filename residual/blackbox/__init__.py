"""Networks without physics: recurrent and feedforward models of the whole motion."""
