"""Reference agents: PPO, and what exploration methods add to it."""
