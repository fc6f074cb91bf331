"""The four sparse Fetch tasks: single environments on Gymnasium-Robotics, and a batched engine on MuJoCo's batch."""
