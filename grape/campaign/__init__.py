"""Missions on many seeds, and what they come to: `grape campaign`."""
