"""What all agents share: rollouts, returns, distributions, networks, hyperparameters."""
