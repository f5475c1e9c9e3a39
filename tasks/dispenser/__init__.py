"""Hanging pheromone dispensers on vines and nails: the task's actions, perception, missions and success criteria."""
