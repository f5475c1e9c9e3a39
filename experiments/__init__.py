"""Experiments: each proves one row of what grape is asked for, `grape reproduce ROW`."""
