"""The dispenser task's actions, one a file."""
