"""Rollouts of a ship with its network on a GPU, beside the processor's.

The machine with the GPU needs numpy, torch, cupy and nvcc, no casadi: ``write`` makes the code, the data and the
figures of the processor; ``run`` is called there; ``record`` puts both into RESULTS.md. Run from the repository root:
python -m benchmarks.gpu_rollouts.write FOLDER; python -m benchmarks.gpu_rollouts.run FOLDER > figures.json;
python -m benchmarks.gpu_rollouts.record FOLDER figures.json
"""
