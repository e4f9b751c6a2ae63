"""Gymnasium environments: tasks, episodes, single and batched."""
