"""Generator of the blind benchmark of the gap diagnosis: trials with a hidden cause, and a sealed key.

It shares no code with what it tests: own numpy models of three ships (exact branches; quadrature or closed form of the
cross-flow; Heun or Runge-Kutta steps), own numerics of every effect, and effects that no library holds. Only numbers of
the ship files are read. world.py has the worlds, library.py the effects that a diagnosis may name, foreign.py
the causes without a name. Whoever works on the diagnosis should not read the effect files of this folder, nor a key.
"""
