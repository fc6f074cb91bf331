"""Fast CPU versions of parts of the networks. Each equals its plain PyTorch version."""
