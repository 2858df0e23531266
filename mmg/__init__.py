"""The symbolic ship: equations of the MMG model and what follows from them alone."""
