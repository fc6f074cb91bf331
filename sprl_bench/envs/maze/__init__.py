"""First-person mazes that stand for three levels of DeepMind Lab: layouts, motion and pictures, all in integers."""
