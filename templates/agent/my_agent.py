"""An agent of your own: copy this folder, rename it, and put your training loop into `train`.

This one is Q-learning with a table of observations, for environments with discrete actions.
"""

from collections import defaultdict

import numpy as np


class QLearning:
    """The keyword arguments after `device` are its hyperparameters: each can be given by --set."""

    def __init__(self, *, seed, device="cpu", learning_rate=0.2, gamma=0.99, epsilon=0.1):
        self.rng = np.random.default_rng(seed)
        self.learning_rate, self.gamma, self.epsilon = learning_rate, gamma, epsilon
        self.values, self.observations = defaultdict(float), None

    def train(self, envs, budget):
        """Step the envs, learn, and yield a few numbers now and then; `sprl-bench` stops it at the budget."""
        self.actions = range(envs.single_action_space.n)
        if self.observations is None:  # else it continues an interrupted run
            self.observations, _ = envs.reset()
        while True:
            errors = [self.learn(*self.step(envs)) for _ in range(100)]
            yield {"td_error": float(np.mean(np.abs(errors))), "table": float(len(self.values))}

    def step(self, envs):
        """Take one step in each of the N envs, and return all that learning needs."""
        before = self.observations
        greedy = np.array([max(self.actions, key=lambda a: self.values[o.tobytes(), a]) for o in before])
        explore = self.rng.random(len(before)) < self.epsilon
        actions = np.where(explore, self.rng.integers(len(self.actions), size=len(before)), greedy)
        self.observations, rewards, terminated, truncated, infos = envs.step(actions)
        after = self.observations.copy()  # those of a new episode where the last one ended
        for row in np.flatnonzero(terminated | truncated):
            after[row] = infos["final_obs"][row]
        return before, actions, rewards, terminated, after

    def learn(self, before, actions, rewards, terminated, after):
        """Move each value towards its target, and return the errors."""
        errors = []
        for row, action in enumerate(actions):
            best = max(self.values[after[row].tobytes(), a] for a in self.actions)
            key = before[row].tobytes(), int(action)
            errors.append(rewards[row] + self.gamma * best * (not terminated[row]) - self.values[key])
            self.values[key] += self.learning_rate * errors[-1]
        return errors

    def state_dict(self):
        """Return all that the rest of training depends on: then an interrupted run continues."""
        keys = np.array([[*np.frombuffer(seen, np.uint8), action] for seen, action in self.values], np.uint8)
        values = np.array([*self.values.values()])
        return {"keys": keys, "values": values, "observations": self.observations, "rng": self.rng.bit_generator.state}

    def load_state_dict(self, state):
        """Take such a state."""
        keys = [(key[:-1].tobytes(), int(key[-1])) for key in np.asarray(state["keys"])]
        self.values = defaultdict(float, zip(keys, np.asarray(state["values"]).tolist(), strict=True))
        self.observations, self.rng.bit_generator.state = np.asarray(state["observations"]), state["rng"]
