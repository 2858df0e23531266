"""Network layers: feedforward, recurrent, initial state, input features."""
