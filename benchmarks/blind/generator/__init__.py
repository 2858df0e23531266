"""Generator of the blind benchmark of the gap diagnosis: trials with a hidden cause, and a sealed key.

It shares no code with what it tests: an own numpy model of the ESSO OSAKA 3 m ship (exact branches, quadrature of the
cross-flow, Heun steps of 0.05 s), own numerics of every effect, and a few effects that no library holds. Only the ship
file's numbers are read. Whoever works on the diagnosis should not read the effect files of this folder, nor a key.
Run from the repository root: python -m benchmarks.blind.generator OUT --cases 100 --seed 1
"""
