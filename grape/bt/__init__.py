"""Behaviour trees: files in BehaviorTree.CPP v4 XML, the leaves that run actions, and the executor that ticks them."""

from grape.bt.executor import TreeExecutor
from grape.bt.loader import check_tree, load_tree, node_library
from grape.bt.merge import merge_includes
from grape.bt.nodes_model import nodes_model
from grape.bt.run import Failure, LeafCrashed
from grape.bt.tree import Node, Tree

__all__ = [
    "Failure",
    "LeafCrashed",
    "Node",
    "Tree",
    "TreeExecutor",
    "check_tree",
    "load_tree",
    "merge_includes",
    "node_library",
    "nodes_model",
]
