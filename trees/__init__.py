"""Behaviour trees as BehaviorTree.CPP v4 XML, one a file; Groot2 opens them."""
