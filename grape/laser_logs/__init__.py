"""Commands on recorded laser logs: build a map of one, and localise one on a map."""
