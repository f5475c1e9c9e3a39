"""Long-running actions, one a file; `grape.actions.core` says what an action is."""
