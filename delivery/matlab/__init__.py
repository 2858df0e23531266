"""The ship for MATLAB and Octave: a function, a struct of parameters, a MEX source."""
