"""What every agent learns with: rollouts, returns, distributions, networks, hyperparameters."""
