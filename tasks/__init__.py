"""Tasks: one package a task, using only what an outsider's task could use."""
