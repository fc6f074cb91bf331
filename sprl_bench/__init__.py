"""sprl-bench: the benchmark for sparse-reward reinforcement learning."""
