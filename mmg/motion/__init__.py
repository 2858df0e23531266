"""Motion through water and air: frames, relative flow, states that remember, functions that are smooth at rest."""
