"""From the symbolic ship to machine code: C with vector lanes, compiled batches and fused rollouts."""
